"""Devices of pyusb that another program answers for."""

from __future__ import annotations

import errno
from typing import Any

import usb.core

from drivers.sim.usb_bus import SimulatedBus


class OtherDevice(SimulatedBus):
    """A bus with one device, which stays, and which nobody else has claimed."""

    address = 1
    held = False

    def _check_plugged(self, _plug: Any) -> None:
        """It stays."""

    def enumerate_devices(self) -> Any:
        """The one device."""
        yield self

    def ctrl_transfer(self, *_: Any) -> int:
        """It has no strings and knows no request of the class."""
        raise usb.core.USBError("Pipe error", errno=errno.EPIPE)

"""A USB bus under the commands: what they would find on a real one."""

from __future__ import annotations

from typing import Any

from drivers.clock import SystemClock
from drivers.ptp import usb as driver
from drivers.sim.address import SimulatedCamera
from drivers.sim.body import Body
from drivers.sim.usb_bus import SimulatedBus

ADDRESS = "ptp+usb://0000001"


class Bus(SimulatedBus):
    """Its camera, once it went away, comes back at the next address after so many looks for it."""

    def __init__(self, away_for: int) -> None:
        camera = SimulatedCamera(width=64, height=64, format="jpeg")
        super().__init__(Body(camera, SystemClock()), SystemClock())
        self.away_for = away_for

    def enumerate_devices(self) -> Any:
        if self._responder.unplugged:
            self.away_for -= 1
            if self.away_for <= 0:
                self.body.fault = "none"
                self.replug()
        yield from super().enumerate_devices()

    @property
    def address(self) -> int:
        """Where on the bus the camera is now."""
        (device,) = driver.find_cameras(self)
        found: int = device.address
        return found

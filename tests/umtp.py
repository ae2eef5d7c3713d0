"""Debian's umtp-responder as a device of pyusb.

It is made for Linux's FunctionFS: it writes its descriptors to ep0, reads what happens on the bus
from there, and has a file per endpoint. Here ep0 is a terminal in raw mode, the others are pipes.
"""

from __future__ import annotations

import errno
import os
import pty
import select
import struct
import subprocess
import threading
import tty
from pathlib import Path
from typing import Any

import usb.core

from tests.other_device import OtherDevice

_BIND, _ENABLE = 0, 2  # events of FunctionFS, linux/usb/functionfs.h
_EVENT = struct.Struct("<8xB3x")
_CONFIGURATION = """
loop_on_disconnect 0
storage "{store}" "card" "rw"
manufacturer "uMTP"
product "Responder"
serial "0042"
firmware_version "1"
interface "MTP"
usb_vendor_id 0x1D6B
usb_product_id 0x0100
usb_class 0x6
usb_subclass 0x1
usb_protocol 0x1
usb_dev_version 0x3008
usb_functionfs_mode 0x1
usb_dev_path "{folder}/ep0"
usb_epin_path "{folder}/ep1"
usb_epout_path "{folder}/ep2"
usb_epint_path "{folder}/ep3"
usb_max_packet_size 0x200
"""


class UmtpResponder(OtherDevice):
    """A bus with that program on it. store: the folder that it offers as its card."""

    def __init__(self, folder: Path, store: Path) -> None:
        self._master, slave = pty.openpty()
        tty.setraw(slave)
        (folder / "ep0").symlink_to(os.ttyname(slave))
        pipes = [folder / f"ep{number}" for number in (1, 2, 3)]
        for pipe in pipes:
            os.mkfifo(pipe)
        self._in, self._out, self._events = (os.open(pipe, os.O_RDWR) for pipe in pipes)
        configuration = folder / "umtprd.conf"
        configuration.write_text(_CONFIGURATION.format(folder=folder, store=store))
        self.log = (folder / "log").open("wb")
        self._process = subprocess.Popen(
            ["umtprd", "-conf", str(configuration)], stdout=self.log, stderr=self.log
        )
        self._slave = slave
        threading.Thread(target=self._drain, daemon=True).start()
        for event in (_BIND, _ENABLE):
            os.write(self._master, _EVENT.pack(event))

    def _drain(self) -> None:
        """Take its descriptors, which nobody needs here."""
        try:
            while os.read(self._master, 4096):
                pass
        except OSError:
            pass  # stopped

    def stop(self) -> None:
        """End the program."""
        self._process.kill()
        self._process.wait()
        for each in (self._master, self._slave, self._in, self._out, self._events):
            os.close(each)
        self.log.close()

    def bulk_write(self, _handle: Any, _ep: int, _intf: int, data: Any, _timeout: int) -> int:
        """Send a container."""
        raw = data.tobytes()
        return os.write(self._out, raw) if raw else 0

    def bulk_read(self, _handle: Any, _ep: int, _intf: int, buffer: Any, timeout: int) -> int:
        """Receive what there is."""
        return _read(self._in, buffer, timeout)

    def intr_read(self, _handle: Any, _ep: int, _intf: int, buffer: Any, timeout: int) -> int:
        """Receive one event: a pipe does not keep them apart, as packets of USB would."""
        view = memoryview(buffer)
        _read(self._events, view[:4], timeout)
        length = int.from_bytes(view[:4], "little")
        return 4 + _read(self._events, view[4:length], timeout)


def _read(pipe: int, buffer: Any, timeout_ms: int) -> int:
    if not select.select([pipe], [], [], timeout_ms / 1000)[0]:
        raise usb.core.USBTimeoutError("late", errno=errno.ETIMEDOUT)
    return os.readv(pipe, [buffer])

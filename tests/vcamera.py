"""libgphoto2's own virtual camera, in the wheel of PyPI's gphoto2, as a device of pyusb.

Its way in is libgphoto2's port library: what a driver writes to an endpoint goes through
gp_port_write, what it reads comes through gp_port_read and gp_port_check_int.
"""

from __future__ import annotations

import ctypes
import errno
import importlib.util
from collections.abc import Callable
from pathlib import Path
from typing import Any

import usb.core

from tests.other_device import OtherDevice

_TIMEOUT = -10
_NIKON, _D750 = 0x04B0, 0x0437


class VirtualCamera(OtherDevice):
    """A bus with that camera on it.

    folder: what is on its card, and what it photographs. set_variable: sets a variable of the
    environment, by which the library is told, until the camera is done with.
    """

    def __init__(self, folder: Path, set_variable: Callable[[str, str], None]) -> None:
        spec = importlib.util.find_spec("gphoto2")
        assert spec is not None and spec.origin is not None
        libraries = Path(spec.origin).parent / "libgphoto2"
        set_variable("IOLIBS", str(libraries / "vusb"))
        set_variable("VCAMERADIR", str(folder))
        self._library = ctypes.CDLL(str(libraries / "libgphoto2_port.so.12"))
        self._port = ctypes.c_void_p()
        self._call("gp_port_new", ctypes.byref(self._port))
        self._call("gp_port_set_info", self._port, self._info())
        self._call("gp_port_usb_find_device", self._port, _NIKON, _D750)
        self._call("gp_port_open", self._port)

    def _info(self) -> ctypes.c_void_p:
        places, info = ctypes.c_void_p(), ctypes.c_void_p()
        self._call("gp_port_info_list_new", ctypes.byref(places))
        self._call("gp_port_info_list_load", places)
        self._call("gp_port_info_list_get_info", places, 0, ctypes.byref(info))
        return info

    def _call(self, name: str, *arguments: Any) -> int:
        code: int = getattr(self._library, name)(*arguments)
        if code == _TIMEOUT:
            raise usb.core.USBTimeoutError(name, errno=errno.ETIMEDOUT)
        if code < 0:
            raise usb.core.USBError(f"{name}: {code}", errno=errno.EIO)
        return code

    def stop(self) -> None:
        """Let go of the library."""
        self._call("gp_port_close", self._port)
        self._call("gp_port_free", self._port)

    def bulk_write(self, _handle: Any, _ep: int, _intf: int, data: Any, _timeout: int) -> int:
        """Send a container."""
        raw = data.tobytes()
        return self._call("gp_port_write", self._port, raw, len(raw)) if raw else 0

    def bulk_read(self, _handle: Any, _ep: int, _intf: int, buffer: Any, _timeout: int) -> int:
        """Receive what there is."""
        return self._into(buffer, "gp_port_read")

    def intr_read(self, _handle: Any, _ep: int, _intf: int, buffer: Any, timeout: int) -> int:
        """Receive an event."""
        self._call("gp_port_set_timeout", self._port, timeout)
        return self._into(buffer, "gp_port_check_int")

    def _into(self, buffer: Any, name: str) -> int:
        place = (ctypes.c_char * len(buffer)).from_buffer(buffer)
        return self._call(name, self._port, place, len(buffer))

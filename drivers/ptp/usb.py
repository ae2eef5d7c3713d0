"""Cameras on USB: found, told apart, opened.

A camera is known by its serial number, since its place on the bus changes with every plug.
"""

from __future__ import annotations

import contextlib
import errno
from typing import Any

import libusb_package
import usb.core

from drivers.camera import Camera, CameraInfo
from drivers.clock import Clock, SystemClock
from drivers.errors import (
    BadAddressError,
    CameraBusyError,
    CameraDisconnectedError,
    CameraNotFoundError,
)
from drivers.ptp.camera import open_awake
from drivers.ptp.usb_transport import FORBIDDEN, GONE, UsbTransport, is_still_image

_ANY = "ptp+usb://"  # the address of the only camera on USB


def find_cameras(backend: Any) -> list[Any]:
    """Find the devices with a still image interface."""

    def matches(device: Any) -> bool:
        with contextlib.suppress(usb.core.USBError):
            return any(is_still_image(interface) for each in device for interface in each)
        return False

    return list(usb.core.find(find_all=True, custom_match=matches, backend=backend) or ())


def _text(device: Any, name: str) -> str:
    """Read a string of a device; empty where it does not tell, or this user may not ask."""
    try:
        return getattr(device, name) or ""
    except (usb.core.USBError, ValueError, RuntimeError):
        return ""


def _is_forbidden(device: Any) -> bool:
    """Whether this user may not ask a device for its serial number."""
    if _text(device, "serial_number"):
        return False
    try:  # pyusb does not say why a device gave no text
        device.get_active_configuration()
    except usb.core.USBError as error:
        return bool(error.errno == errno.EACCES)
    return False


def connect(serial: str, backend: Any, clock: Clock) -> UsbTransport:
    """Connect to the camera with that serial number, or to the only one if that is empty."""
    try:
        devices = find_cameras(backend)
    except usb.core.USBError as error:
        raise CameraDisconnectedError(GONE) from error
    wanted = [each for each in devices if not serial or _text(each, "serial_number") == serial]
    if not wanted:
        if any(map(_is_forbidden, devices)):  # it may be the one
            raise CameraNotFoundError(FORBIDDEN)
        raise CameraNotFoundError(
            f"No camera {f'with the serial number {serial} ' if serial else ''}is on USB: switch "
            "it on, plug it in and try again."
        )
    if len(wanted) > 1:
        addresses = [describe(each).address for each in wanted]
        one_each = [each for each in addresses if each != _ANY and addresses.count(each) == 1]
        what = f"name one of {', '.join(one_each)}" if one_each else "unplug the others"
        raise CameraBusyError(f"More than one camera is on USB: {what}.")
    return UsbTransport(wanted[0], clock)


def _libusb() -> Any:
    backend = libusb_package.get_libusb1_backend()
    if backend is None:
        raise CameraNotFoundError(
            "This computer has no USB that lightlayers could use: plug the camera into another "
            "one, or use it over a network (ptp+ip://)."
        )
    return backend


def open_camera(address: str) -> Camera:
    """Open the camera at ptp+usb://serial, or the only one at ptp+usb://."""
    serial, clock = _parse(address), SystemClock()
    return open_awake(address, lambda: connect(serial, _libusb(), clock), clock)


def check_address(address: str) -> None:
    """Read the address. Raises BadAddressError."""
    _parse(address)


def list_cameras() -> list[CameraInfo]:
    """List the cameras on USB, without opening a session."""
    try:
        devices = find_cameras(_libusb())
    except (usb.core.USBError, CameraNotFoundError):
        return []
    return [describe(device) for device in devices]


def describe(device: Any) -> CameraInfo:
    """Tell who a device is, as far as it tells without a session."""
    make, model, serial = (
        _text(device, name) for name in ("manufacturer", "product", "serial_number")
    )
    place = serial if _fits(serial) else ""  # the only one on USB can be used without it
    return CameraInfo(f"{_ANY}{place}", make, model, serial, None)


def _fits(serial: str) -> bool:
    """Whether a serial number can stand in an address."""
    return serial.isprintable() and not set(serial) & set("/?#@ ")


def _parse(address: str) -> str:
    serial = address.partition("://")[2].rstrip("/")
    if not _fits(serial):
        raise BadAddressError(
            f"{address!r} is no address of a camera on USB: write ptp+usb:// and its serial number."
        )
    return serial

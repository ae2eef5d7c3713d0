from __future__ import annotations

import errno
from types import SimpleNamespace
from typing import Any

import pytest
import usb.core

from drivers.camera import CameraInfo
from drivers.capture import capture_pair
from drivers.clock import Clock
from drivers.errors import (
    BadAddressError,
    CameraBusyError,
    CameraDisconnectedError,
    CameraNotFoundError,
)
from drivers.ptp import usb as driver
from drivers.ptp.camera import PtpCamera
from drivers.sim.usb_bus import SimulatedBus


def test_cameras_are_found_by_their_interface(bus: SimulatedBus) -> None:
    (device,) = driver.find_cameras(bus)
    assert driver.describe(device) == CameraInfo(
        "ptp+usb://0000001", "NIKON CORPORATION", "NIKON D5100", "0000001", None
    )


@pytest.mark.parametrize("serial", ["", "12 34", "12/34", "a?b", "a#b", "a@b", "12\0", "1\n2"])
def test_a_serial_number_that_no_address_can_have_is_left_out_of_it(serial: str) -> None:
    """Or a service with such a camera could list none."""
    device = SimpleNamespace(manufacturer="Make", product="Model", serial_number=serial)
    info = driver.describe(device)
    assert info.address == "ptp+usb://"
    assert (info.make, info.model) == ("Make", "Model")
    driver.check_address(info.address)


def test_a_pair_comes_over_usb(bus: SimulatedBus, clock: Clock) -> None:
    with PtpCamera("ptp+usb://", driver.connect("0000001", bus, clock), clock) as camera:
        pair = capture_pair(camera, clock=clock)
    assert [shot.exposure.flash_fired for shot in (pair.no_flash, pair.flash)] == [False, True]


def test_a_camera_is_known_by_its_serial_number(bus: SimulatedBus, clock: Clock) -> None:
    with pytest.raises(CameraNotFoundError, match="with the serial number 77 is on USB"):
        driver.connect("77", bus, clock)


@pytest.mark.parametrize(
    ("number", "what"), [(errno.EACCES, "may not use .* udev rule"), (errno.EIO, "is on USB")]
)
def test_a_camera_named_by_a_number_that_this_user_may_not_ask_for_may_be_there(
    bus: SimulatedBus, clock: Clock, number: int, what: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def open_device(_device: Any) -> Any:
        raise usb.core.USBError("Access denied", errno=number)

    monkeypatch.setattr(bus, "open_device", open_device)
    with pytest.raises(CameraNotFoundError, match=what):
        driver.connect("0000001", bus, clock)


def test_a_camera_that_is_not_there_is_not_found(bus: SimulatedBus, clock: Clock) -> None:
    bus._responder.unplugged = True
    with pytest.raises(CameraNotFoundError, match="No camera is on USB"):
        driver.connect("", bus, clock)


@pytest.mark.parametrize(
    ("serials", "what"),
    [
        (["12", "34"], "name one of ptp+usb://12, ptp+usb://34."),
        (["12", "\x1b[2J", ""], "name one of ptp+usb://12."),
        (["3 4", "3/4"], "unplug the others."),
        (["12", "12"], "unplug the others."),
    ],
)
def test_of_more_than_one_camera_those_are_named_that_an_address_leads_to(
    serials: list[str], what: str, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = [
        SimpleNamespace(manufacturer="Make", product="Model", serial_number=serial)
        for serial in serials
    ]
    monkeypatch.setattr(driver, "find_cameras", lambda _backend: found)
    with pytest.raises(CameraBusyError) as raised:
        driver.connect("", None, clock)
    assert str(raised.value) == f"More than one camera is on USB: {what}"


def test_a_bus_that_cannot_be_listed_is_told_as_a_broken_connection(
    bus: SimulatedBus, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    def enumerate_devices() -> Any:
        raise usb.core.USBError("Other error", errno=errno.EIO)

    monkeypatch.setattr(bus, "enumerate_devices", enumerate_devices)
    with pytest.raises(CameraDisconnectedError, match="plug it in again"):
        driver.connect("", bus, clock)


@pytest.mark.parametrize("address", ["ptp+usb://a/b", "ptp+usb://a?b", "ptp+usb://a b"])
def test_addresses_that_are_no_serial_number_are_refused(address: str) -> None:
    with pytest.raises(BadAddressError, match="its serial number"):
        driver.check_address(address)


def test_without_usb_there_is_no_camera_and_it_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("libusb_package.get_libusb1_backend", lambda: None)
    with pytest.raises(CameraNotFoundError) as refusal:
        driver.open_camera("ptp+usb://")
    assert str(refusal.value) == (
        "This computer has no USB that lightlayers could use: plug the camera into another one, or "
        "use it over a network (ptp+ip://)."
    )
    assert driver.list_cameras() == []

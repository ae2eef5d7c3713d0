from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from drivers import returning
from drivers.camera import Camera, CameraInfo
from drivers.capture import capture_pair
from drivers.clock import Clock
from drivers.errors import (
    BadAddressError,
    CameraBusyError,
    CameraDisconnectedError,
    CameraNotFoundError,
    DriverError,
    MissingPackageError,
    ProtocolError,
    SettingError,
    StoreFullError,
)
from drivers.ptp import usb as driver
from drivers.ptp.camera import PtpCamera
from drivers.returning import ReturningCamera
from drivers.sim.address import SimulatedCamera
from drivers.sim.body import Body
from drivers.sim.usb_bus import SimulatedBus

ADDRESS = "ptp+usb://0000001"


class Bus(SimulatedBus):
    """Comes back at the bus's next address after some looks for it."""

    looks = 0

    def enumerate_devices(self) -> Any:
        if self._responder.unplugged and self.looks:
            self.looks -= 1
            if not self.looks:
                self.body.fault = "none"
                self.replug()
        yield from super().enumerate_devices()


@pytest.fixture
def bus(clock: Clock, monkeypatch: pytest.MonkeyPatch) -> Bus:
    bus = Bus(Body(SimulatedCamera(width=64, height=64, format="jpeg"), clock), clock)

    def open_camera(address: str) -> Camera:
        assert address == ADDRESS
        return PtpCamera(address, driver.connect("0000001", bus, clock), clock)

    monkeypatch.setattr(returning, "open_camera", open_camera)
    return bus


@pytest.fixture
def told() -> list[str]:
    return []


@pytest.fixture
def camera(bus: Bus, told: list[str], clock: Clock) -> ReturningCamera:  # noqa: ARG001
    return ReturningCamera(ADDRESS, told.append, clock)


def test_it_stays_open_while_it_answers(camera: ReturningCamera, told: list[str]) -> None:
    assert camera.connected() is camera.connected()
    assert told == []


def test_unplugged_in_a_transfer_it_is_found_at_its_next_address(
    camera: ReturningCamera, bus: Bus, told: list[str], clock: Clock
) -> None:
    bus.body.fault = "unplug"
    with pytest.raises(CameraDisconnectedError, match="plug it in again"):
        capture_pair(camera.connected(), clock=clock)
    bus.looks = 5
    pair = capture_pair(camera.connected(wait_s=60), clock=clock)
    assert [shot.exposure.flash_fired for shot in (pair.no_flash, pair.flash)] == [False, True]
    assert [device.address for device in driver.find_cameras(bus)] == [2]
    assert len(told) == 2
    assert told[0].startswith("No camera with the serial number 0000001 is on USB")
    assert told[0].endswith("It is waited for.")
    assert told[1] == "The camera is there."


def test_what_was_opened_before_it_was_unplugged_is_gone(bus: Bus, clock: Clock) -> None:
    old = PtpCamera(ADDRESS, driver.connect("0000001", bus, clock), clock)
    bus.replug()
    with pytest.raises(CameraDisconnectedError):
        old.objects()


def test_it_is_waited_for_no_longer_than_said(
    camera: ReturningCamera, bus: Bus, clock: Clock
) -> None:
    bus._responder.unplugged = True
    with pytest.raises(CameraNotFoundError):
        camera.connected()
    assert clock.monotonic() == 0
    with pytest.raises(CameraNotFoundError):
        camera.connected(wait_s=10)
    assert clock.monotonic() == pytest.approx(10, abs=returning.LOOK_S)


def test_why_it_is_not_there_is_told_anew_when_it_changes(
    camera: ReturningCamera, told: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: Callable[[str], Camera] = vars(returning)["open_camera"]
    errors = [CameraBusyError("In use."), CameraBusyError("In use."), CameraNotFoundError("Away.")]

    def open_camera(address: str) -> Camera:
        if errors:
            raise errors.pop(0)
        return opened(address)

    monkeypatch.setattr(returning, "open_camera", open_camera)
    camera.connected(wait_s=60)
    assert told == ["In use. It is waited for.", "Away. It is waited for.", "The camera is there."]


@pytest.mark.parametrize(
    "error", [ProtocolError("Strange"), SettingError("Refused."), StoreFullError("No card.")]
)
def test_a_strange_answer_is_waited_out_and_told_once(
    camera: ReturningCamera,
    told: list[str],
    error: DriverError,
    monkeypatch: pytest.MonkeyPatch,
    clock: Clock,
) -> None:
    info, errors = PtpCamera.info, [error] * 3

    def strange(own: PtpCamera) -> CameraInfo:
        if errors:
            raise errors.pop()
        return info(own)

    monkeypatch.setattr(PtpCamera, "info", strange)
    with pytest.raises(type(error)):
        camera.connected()
    assert told == []
    assert camera.connected(wait_s=60).info().serial == "0000001"
    assert told == [f"{error} It is waited for.", "The camera is there."]
    assert clock.monotonic() == 2 * returning.LOOK_S


def test_another_camera_at_its_address_is_not_taken_for_it(
    camera: ReturningCamera, bus: Bus, monkeypatch: pytest.MonkeyPatch, clock: Clock
) -> None:
    camera.connected()
    bus.replug()
    other = SimulatedBus(Body(SimulatedCamera(width=64, height=64, camera="native"), clock), clock)
    monkeypatch.setattr(
        returning,
        "open_camera",
        lambda address: PtpCamera(address, driver.connect("", other, clock), clock),
    )
    with pytest.raises(CameraNotFoundError, match="number 0000002 in place of 0000001"):
        camera.connected()


def test_an_address_that_is_none_is_not_waited_for(told: list[str]) -> None:
    with pytest.raises(BadAddressError):
        ReturningCamera("ptp+usb://a b", told.append)
    with pytest.raises(CameraNotFoundError):
        ReturningCamera("sim://garden", told.append)


def test_a_package_that_is_missing_is_not_waited_for(
    told: list[str], clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nor does it make the address a bad one: another host may have the package."""
    monkeypatch.setattr("importlib.util.find_spec", lambda _name: None)
    camera = ReturningCamera("gphoto2://", told.append, clock)
    with pytest.raises(MissingPackageError, match="package gphoto2 is missing here"):
        camera.connected(wait_s=600)
    assert (told, clock.monotonic()) == ([], 0)


def test_closing_twice_is_fine(camera: ReturningCamera, bus: Bus) -> None:
    camera.connected()
    camera.close()
    camera.close()
    bus.held = True
    with pytest.raises(CameraBusyError, match="in use"):
        camera.connected()

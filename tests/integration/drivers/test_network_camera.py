"""Our driver and our simulated camera, in two processes, over PTP/IP."""

from __future__ import annotations

import time
from typing import Any

import pytest

import drivers
from drivers.clock import SystemClock
from drivers.errors import CameraBusyError, FocusError, ProtocolError, StoreFullError, TransferError
from drivers.ptp.camera import PtpCamera
from drivers.ptp.ip import IpTransport


def take(camera: Any) -> drivers.CapturedPair:
    with drivers.open_camera(camera.address) as opened:
        return drivers.capture_pair(opened)


def is_pair(pair: drivers.CapturedPair) -> bool:
    shots = pair.no_flash, pair.flash
    return [shot.exposure.flash_fired for shot in shots] == [False, True] and all(
        shot.files.keys() == {"dng", "jpeg"} for shot in shots
    )


def test_the_camera_says_who_it_is(camera: Any) -> None:
    with drivers.open_camera(camera.address) as opened:
        info = opened.info()
    assert info == drivers.CameraInfo(
        camera.address, "NIKON CORPORATION", "NIKON D5100", "0000001", 87, 2 * 10**9
    )


def test_the_photographs_are_those_of_the_same_camera_without_a_network(camera: Any) -> None:
    pair = take(camera)
    with drivers.open_camera("sim://studio?width=300&height=200&format=both") as opened:
        direct = drivers.capture_pair(opened)
    assert is_pair(pair)
    assert pair.flash.exposure == direct.flash.exposure
    assert len(pair.flash.files["dng"]) == len(direct.flash.files["dng"])


@pytest.mark.parametrize(
    "fault", ["busy_briefly", "broken_transfer", "short_packets", "glued_packets", "slow_link"]
)
def test_passing_faults_are_got_over(camera: Any, fault: str) -> None:
    camera.order(f"fault {fault}")
    assert is_pair(take(camera))


@pytest.mark.parametrize(
    ("fault", "error", "sentence"),
    [
        ("focus", FocusError, "focus by hand"),
        ("store_full", StoreFullError, "make room on it"),
        ("garbled", ProtocolError, "switch the camera off and on"),
        ("hostile", ProtocolError, "ends too early"),
        ("unplug", drivers.CameraDisconnectedError, "connect it again"),
        ("truncated", TransferError, "bytes where"),
        ("huge_size", TransferError, "4294967295 bytes"),
        ("flash_locked", drivers.SettingError, "on the camera alone"),
    ],
)
def test_after_a_lasting_fault_the_next_capture_works(
    camera: Any, fault: str, error: type[drivers.DriverError], sentence: str
) -> None:
    camera.order(f"fault {fault}")
    with pytest.raises(error, match=sentence):
        take(camera)
    camera.order("fault none")
    assert is_pair(take(camera))


def test_a_second_client_is_told_that_the_camera_is_in_use(camera: Any) -> None:
    camera.order("fault none")
    with drivers.open_camera(camera.address) as first:
        with pytest.raises(CameraBusyError, match="in use by another program"):
            drivers.open_camera(camera.address)
        assert first.objects()
    assert drivers.open_camera(camera.address).close() is None


def connected(camera: Any, answer_s: float) -> IpTransport:
    """Connect, once the camera has noticed that its last visitor has left."""
    for _ in range(100):
        try:
            return IpTransport("127.0.0.1", camera.port, answer_s)
        except CameraBusyError:
            time.sleep(0.1)
    pytest.fail("the camera stays in use")


def test_a_camera_that_says_nothing_is_told_from_one_that_is_gone(camera: Any) -> None:
    camera.order("fault silent")
    with (
        PtpCamera(camera.address, connected(camera, 3), SystemClock()) as opened,
        pytest.raises(drivers.CameraTimeoutError, match="though it is there"),
    ):
        opened.trigger()
    camera.order("fault none")
    assert is_pair(take(camera))


def test_nobody_there_is_said() -> None:
    with pytest.raises(drivers.CameraNotFoundError, match=r"No camera answers at 127.0.0.1:1:"):
        drivers.open_camera("ptp+ip://127.0.0.1:1")

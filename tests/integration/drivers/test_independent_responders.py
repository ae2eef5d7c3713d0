"""Our driver of USB cameras against responders that others wrote.

Neither tells of a full card: the virtual camera has no such state, and umtp-responder takes more
than its card can hold and says that all is well.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from random import Random

import pytest
from PIL import Image

import drivers
from drivers.camera import CameraObject, Event, EventKind
from drivers.clock import SystemClock
from drivers.ptp import usb
from drivers.ptp.camera import PtpCamera
from drivers.shot import fetch
from tests.umtp import UmtpResponder
from tests.vcamera import VirtualCamera

_RANDOM = Random(1)


@pytest.fixture
def bus(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[VirtualCamera]:
    noise = Image.frombytes("RGB", (700, 500), _RANDOM.randbytes(700 * 500 * 3))
    noise.save(tmp_path / "GPH_0001.JPG", quality=95)
    bus = VirtualCamera(tmp_path, monkeypatch.setenv)
    yield bus
    bus.stop()


@pytest.fixture
def virtual(bus: VirtualCamera) -> Iterator[PtpCamera]:
    with PtpCamera("vcamera", usb.connect("", bus, SystemClock()), SystemClock()) as camera:
        yield camera


@pytest.fixture
def responder(tmp_path: Path, lacking: Callable[[str], None]) -> Iterator[PtpCamera]:
    if shutil.which("umtprd") is None:
        lacking("umtprd")
    card = tmp_path / "card"
    card.mkdir()
    (card / "DSC_0001.NEF").write_bytes(_RANDOM.randbytes(5_000_000))
    (card / "DSC_0002.JPG").write_bytes(_RANDOM.randbytes(1000 * 512 - 12))  # no short packet
    bus = UmtpResponder(tmp_path, card)
    with PtpCamera("umtp", usb.connect("", bus, SystemClock()), SystemClock()) as camera:
        yield camera
    bus.stop()


def files(camera: drivers.Camera) -> list[CameraObject]:
    described = [camera.describe(handle) for handle in sorted(camera.objects())]
    return [item for item in described if item.kind != "folder"]


def test_the_virtual_camera_says_who_it_is_and_takes_settings(virtual: PtpCamera) -> None:
    assert virtual.info() == drivers.CameraInfo("vcamera", "GP", "VC", "0.1", 50, 555_819_297)
    assert virtual.write(drivers.SettingName.F_NUMBER, 8.0).value == 8.0
    assert virtual.read(drivers.SettingName.F_NUMBER).value == 8.0
    with pytest.raises(drivers.SettingError, match=r"offers no f_number of 9\.5"):
        virtual.write(drivers.SettingName.F_NUMBER, 9.5)


def test_the_virtual_camera_has_no_flash_to_switch_and_this_is_said_first(
    virtual: PtpCamera,
) -> None:
    before = virtual.objects()
    with pytest.raises(drivers.SettingError, match="lets no computer switch its flash"):
        drivers.capture_pair(virtual)
    assert virtual.objects() == before


def test_photographs_of_the_virtual_camera_come_whole(virtual: PtpCamera, tmp_path: Path) -> None:
    stored = (tmp_path / "GPH_0001.JPG").read_bytes()
    (item,) = files(virtual)
    assert (item.kind, item.size, item.name) == ("jpeg", len(stored), "GPH_0001.JPG")
    assert fetch(virtual, item) == stored
    assert b"".join(virtual.download(item.handle, 1000)) == stored[1000:]


@pytest.mark.usefixtures("bus")
def test_photographs_of_the_virtual_camera_come_whole_by_libgphoto2(tmp_path: Path) -> None:
    """It gives libgphoto2 no parts of a file."""
    stored = (tmp_path / "GPH_0001.JPG").read_bytes()
    with drivers.open_camera("gphoto2://") as camera:
        (item,) = files(camera)
        assert fetch(camera, item) == stored
        assert b"".join(camera.download(item.handle, 1000)) == stored[1000:]


def test_the_virtual_camera_tells_of_what_it_photographs(
    virtual: PtpCamera, tmp_path: Path
) -> None:
    before = {item.handle for item in files(virtual)}
    virtual.trigger()
    told = list[Event]()
    while len(told) < 2:  # of a new folder and of the photograph
        told += virtual.events(timeout_s=10)
    (new,) = [item for item in files(virtual) if item.handle not in before]
    assert Event(EventKind.OBJECT_ADDED, new.handle) in told
    assert fetch(virtual, new) == (tmp_path / "GPH_0001.JPG").read_bytes()


def test_files_of_the_responder_come_whole(responder: PtpCamera, tmp_path: Path) -> None:
    found = {item.name: item for item in files(responder)}
    assert {name: item.kind for name, item in found.items()} == {
        "DSC_0001.NEF": "nef",
        "DSC_0002.JPG": "jpeg",
    }
    for name, item in found.items():
        stored = (tmp_path / "card" / name).read_bytes()
        assert fetch(responder, item) == stored
        assert b"".join(responder.download(item.handle, 100_001)) == stored[100_001:]


def test_the_responder_tells_of_new_files_and_deletes_them(
    responder: PtpCamera, tmp_path: Path
) -> None:
    before = responder.objects()
    (tmp_path / "card" / "DSC_0003.JPG").write_bytes(b"new")
    told = responder.events(timeout_s=10)
    (new,) = responder.objects() - before
    assert Event(EventKind.OBJECT_ADDED, new) in told
    responder.delete(new)
    assert responder.objects() == before
    assert not (tmp_path / "card" / "DSC_0003.JPG").exists()


def test_what_the_responder_cannot_do_is_an_error(responder: PtpCamera) -> None:
    asked = list[str]()

    def ask(request: str, _timeout_s: float) -> bool:
        asked.append(request)
        return True

    with pytest.raises(drivers.SettingError, match="takes no order to release over PTP"):
        drivers.capture_pair(responder, flash=drivers.OperatorFlash(ask, len))
    assert asked == []
    with pytest.raises(drivers.DriverError):
        responder.describe(999)
    assert len(responder.objects()) == 2

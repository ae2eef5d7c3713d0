"""A camera behind the process of libgphoto2, whose answers are made here."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from drivers.camera import CameraObject, Event, EventKind, Setting, SettingName
from drivers.errors import CameraTimeoutError, SettingError, TransferError
from drivers.gphoto.backend import FIRST_LISTING_S, SLOWEST, GphotoCamera
from drivers.shot import fetch


class Answering(GphotoCamera):
    """A camera with one file, which is as long as it is when it is asked for."""

    def __init__(self, file: bytes) -> None:
        self.file = file

    def _call(self, method: str, *arguments: Any, patience_s: float = 0.0) -> Any:  # noqa: ARG002
        if method == "describe":
            return CameraObject(1, "jpeg", len(self.file), "DSC_1.JPG", "store_00010001")
        offset = arguments[1]
        return self.file[offset : offset + 4]


def test_a_file_is_fetched_chunk_by_chunk() -> None:
    camera = Answering(b"0123456789")
    assert fetch(camera, camera.describe(1)) == b"0123456789"


@pytest.mark.parametrize("size", [9, 11])
def test_a_file_whose_size_changes_is_no_photograph(size: int) -> None:
    camera = Answering(b"0123456789")
    described = camera.describe(1)
    camera.file = bytes(size)
    with pytest.raises(TransferError, match=f"says {size} bytes where it said 10 before"):
        fetch(camera, described)


class Whole(Answering):
    """A camera that gives its file as a whole alone."""

    def _call(self, method: str, *arguments: Any, patience_s: float = 0.0) -> Any:
        if method == "chunk":
            return None
        if method == "whole":
            assert (arguments, patience_s) == ((1,), len(self.file) / SLOWEST)
            return self.file
        return super()._call(method, *arguments)


def test_a_file_is_fetched_whole_from_a_camera_that_gives_no_parts() -> None:
    camera = Whole(b"0123456789")
    assert fetch(camera, camera.describe(1)) == b"0123456789"
    assert b"".join(camera.download(1, 4)) == b"456789"


class Stubborn(GphotoCamera):
    """A camera that takes a setting and keeps another."""

    def __init__(self) -> None:
        self.written: list[tuple[Any, ...]] = []

    def _call(self, method: str, *arguments: Any, patience_s: float = 0.0) -> Any:  # noqa: ARG002
        if method == "write":
            self.written.append(arguments)
            return None
        return Setting(SettingName.ISO, 200, (100, 200), writable=True)


def test_a_setting_that_reads_back_otherwise_is_an_error() -> None:
    camera = Stubborn()
    assert camera.write(SettingName.ISO, 200).value == 200
    with pytest.raises(SettingError, match="told to set iso to 100 but kept 200"):
        camera.write(SettingName.ISO, 100)
    assert camera.written == [(SettingName.ISO, 200), (SettingName.ISO, 100)]


class Listing(GphotoCamera):
    """A camera with these folders, {folder: (handles, folders)}; calls are noted.

    slow: a folder that does not come in time. coming: files of a folder that are listed once the
    camera was asked for events, and the events told then.
    """

    def __init__(self, card: dict[str, tuple[set[int], list[str]]], slow: str = "") -> None:
        self._listed, self._told, self._call_s = set(), [], 20.0
        self.coming: list[tuple[str, int, Event]] = []
        self.waits: list[tuple[float, float]] = []
        self.card, self.slow = card, slow
        self.calls: list[tuple[str, float]] = []

    def _call(self, method: str, *arguments: Any, patience_s: float = 0.0) -> Any:
        if method == "events":
            (timeout_s,) = arguments
            return self._asked_for_events(timeout_s, patience_s)
        assert method == "list_folder"
        (folder,) = arguments
        self.calls.append((folder, patience_s))
        if folder == self.slow:
            raise CameraTimeoutError("no answer")
        return self.card[folder]

    def _asked_for_events(self, timeout_s: float, patience_s: float) -> list[Event]:
        self.waits.append((timeout_s, patience_s))
        coming, self.coming = self.coming, []
        for folder, handle, _ in coming:
            self.card[folder][0].add(handle)
        return [event for _, _, event in coming]


CARD: dict[str, tuple[set[int], list[str]]] = {
    "/": (set(), ["/a", "/b"]),
    "/a": ({1}, ["/a/DCIM"]),
    "/b": (set(), []),
    "/a/DCIM": ({2, 3}, []),
}


def test_a_full_card_is_listed_folder_by_folder_with_patience_for_the_first_time() -> None:
    camera = Listing(dict(CARD))
    assert camera.objects() == {1, 2, 3}
    assert camera.calls == [(folder, FIRST_LISTING_S) for folder in ("/", "/a", "/b", "/a/DCIM")]
    camera.calls.clear()
    camera.card["/b"] = ({4}, ["/b/new"])
    camera.card["/b/new"] = ({5}, [])
    assert camera.objects() == {1, 2, 3, 4, 5}
    assert [patience_s for _, patience_s in camera.calls] == [0, 0, 0, 0, FIRST_LISTING_S]


def test_a_card_that_takes_too_long_is_told() -> None:
    camera = Listing(CARD, slow="/a/DCIM")
    with pytest.raises(CameraTimeoutError) as raised:
        camera.objects()
    assert str(raised.value) == (
        "libgphoto2 could not list the folder /a/DCIM of the camera in 200 s: its card holds many "
        "photographs: empty it, switch the camera off and on and take the pair anew."
    )


def test_a_camera_that_fails_to_list_what_it_listed_before_hangs() -> None:
    camera = Listing(CARD)
    camera.objects()
    camera.slow = "/b"
    with pytest.raises(CameraTimeoutError, match="no answer"):
        camera.objects()


def test_folders_in_each_other_without_end_are_left() -> None:
    class Endless(Listing):
        def _call(self, method: str, *arguments: Any, patience_s: float = 0.0) -> Any:  # noqa: ARG002
            if method == "events":
                return []
            (folder,) = arguments
            return {len(folder)}, [f"{folder.rstrip('/')}/a"]

    assert len(Endless({}).objects()) == 17


ADDED, COMPLETE = Event(EventKind.OBJECT_ADDED), Event(EventKind.CAPTURE_COMPLETE)


def test_a_file_that_libgphoto2_learns_of_by_an_event_is_listed() -> None:
    camera = Listing({"/": ({1}, [])})
    camera.coming = [("/", 2, ADDED)]
    assert camera.objects() == {1, 2}
    assert camera.waits == [(0, 0)]


def test_events_that_a_list_has_asked_for_are_told_to_whoever_waits_for_them() -> None:
    camera = Listing({"/": ({1}, [])})
    camera.coming = [("/", 2, ADDED)]
    camera.objects()
    camera.coming = [("/", 3, COMPLETE)]
    camera.objects()
    camera.waits.clear()
    assert camera.events(timeout_s=7) == [ADDED, COMPLETE]
    assert camera.events(timeout_s=7) == []
    assert camera.waits == [(0, 0), (7, 7)]  # nothing more is waited for where something is told


LIBRARY = """
import pathlib, time
GP_EVENT_TIMEOUT, GP_EVENT_FILE_ADDED, GP_EVENT_CAPTURE_COMPLETE = range(3)
class GPhoto2Error(Exception):
    code, string = -2, "Bad parameters"
class Camera:
    def init(self): pass
    def get_single_config(self, name): raise GPhoto2Error
    def get_storageinfo(self): return []
    def wait_for_event(self, wait_ms):
        time.sleep(wait_ms / 1000)
        return GP_EVENT_TIMEOUT, None
    def exit(self):
        time.sleep(0.2)
        pathlib.Path(__file__).with_name("given_back").touch()
"""


@pytest.fixture
def interrupted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[GphotoCamera]:
    """A camera of a library made here, where a Ctrl-C has cut a call."""
    (tmp_path / "gphoto2.py").write_text(LIBRARY)
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}:{os.environ.get('PYTHONPATH', '')}")
    camera = GphotoCamera("gphoto2://", "", call_s=60)

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("select.select", interrupt)
        with pytest.raises(KeyboardInterrupt):
            camera.events(0.3)
    yield camera
    camera.close()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_an_interrupted_camera_is_given_back(
    interrupted: GphotoCamera, tmp_path: Path, number: signal.Signals
) -> None:
    assert interrupted._child is not None
    os.kill(interrupted._child.pid, number)  # a terminal or systemd sends it to both processes
    interrupted.close()
    assert (tmp_path / "given_back").exists()


def test_the_answer_to_an_interrupted_call_is_taken_for_no_other(
    interrupted: GphotoCamera,
) -> None:
    assert interrupted.info().address == "gphoto2://"

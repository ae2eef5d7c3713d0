"""The process of libgphoto2, without it: its import changes the plug-ins of every later test."""

from __future__ import annotations

import importlib
import itertools
import sys
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest

from drivers.camera import CameraObject, EventKind, SettingName
from drivers.errors import SettingError

TIMEOUT, FILE_ADDED, CAPTURE_COMPLETE, UNKNOWN = range(4)


class Device:
    """What libgphoto2 has for a camera: one setting, and these events. waits: in ms."""

    def __init__(self) -> None:
        self.events: Iterator[int] = iter(())
        self.waits: list[int] = []

    def get_single_config(self, _name: str) -> SimpleNamespace:
        choices = ["1/50", "0.1s", "Bu\x1blb"]
        return SimpleNamespace(get_readonly=lambda: False, get_choices=lambda: choices)

    def wait_for_event(self, wait_ms: int) -> tuple[int, None]:
        self.waits.append(wait_ms)
        return next(self.events, TIMEOUT), None

    def folder_list_folders(self, folder: str) -> list[tuple[str, None]]:
        """Two cards, with nothing but files on them."""
        return [("store_00010001", None), ("store_00020001", None)] if folder == "/" else []

    def folder_list_files(self, folder: str) -> list[tuple[str, None]]:
        return [] if folder == "/" else [("DSC_1.JPG", None)]

    def file_get_info(self, _folder: str, _name: str) -> SimpleNamespace:
        return SimpleNamespace(file=SimpleNamespace(size=7))


@pytest.fixture
def device() -> Device:
    return Device()


@pytest.fixture
def calls(device: Device, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    library = SimpleNamespace(
        Camera=lambda: device,
        GP_EVENT_TIMEOUT=TIMEOUT,
        GP_EVENT_FILE_ADDED=FILE_ADDED,
        GP_EVENT_CAPTURE_COMPLETE=CAPTURE_COMPLETE,
    )
    monkeypatch.setitem(sys.modules, "gphoto2", library)
    yield importlib.import_module("drivers.gphoto.child").Calls()
    del sys.modules["drivers.gphoto.child"]


def test_the_first_event_is_waited_for_and_those_behind_it_are_taken(
    calls: Any, device: Device
) -> None:
    device.events = iter((FILE_ADDED, UNKNOWN, CAPTURE_COMPLETE))
    assert [event.kind for event in calls.events(1.5)] == [
        EventKind.OBJECT_ADDED,
        EventKind.OTHER,
        EventKind.CAPTURE_COMPLETE,
    ]
    assert device.waits == [1500, 0, 0, 0]


def test_where_nothing_is_told_there_is_none(calls: Any, device: Device) -> None:
    assert calls.events(0.2) == []
    assert device.waits == [200]


def test_events_without_end_are_taken_in_parts(calls: Any, device: Device) -> None:
    device.events = itertools.repeat(UNKNOWN, 1500)
    assert [len(calls.events(1.0)) for _ in range(3)] == [1000, 500, 0]


def test_a_value_that_the_camera_lacks_is_refused_with_those_that_can_be_written(
    calls: Any,
) -> None:
    with pytest.raises(SettingError) as raised:
        calls.write(SettingName.SHUTTER_S, 3)
    assert str(raised.value) == ("The camera offers no shutter_s of 3; it offers 0.02, 0.1, Bulb.")


def test_a_file_is_described_with_the_card_that_it_is_on(calls: Any) -> None:
    assert [calls.describe(handle) for handle in sorted(calls.objects())] == [
        CameraObject(1, "jpeg", 7, "DSC_1.JPG", "store_00010001"),
        CameraObject(2, "jpeg", 7, "DSC_1.JPG", "store_00020001"),
    ]

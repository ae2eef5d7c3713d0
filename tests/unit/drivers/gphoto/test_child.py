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
from drivers.errors import (
    CameraBusyError,
    CameraDisconnectedError,
    DriverError,
    SettingError,
)

TIMEOUT, FILE_ADDED, CAPTURE_COMPLETE, UNKNOWN = range(4)
BAD_PARAMETERS, NOT_SUPPORTED, IO, BUSY = -2, -6, -7, -110
FREE, TEXT, RANGE, RADIO = 64, 2, 3, 5
IMAGE, TRIGGER, DELETE = 1, 32, 2

Store = SimpleNamespace

FILES = {("/store_00010001", "DSC_1.JPG"): b"0123456", ("/store_00020001", "DSC_1.JPG"): b"abcdefg"}


class LibraryError(Exception):
    """As libgphoto2 raises it."""

    def __init__(self, code: int) -> None:
        super().__init__(code)
        self.code, self.string = code, {IO: "I/O problem"}.get(code, "Bad parameters")


class Widget:
    """A setting with choices, as it was read."""

    def __init__(self, value: str, *choices: str) -> None:
        self.value, self.choices = value, choices

    def get_value(self) -> str:
        return self.value

    def set_value(self, value: str) -> None:
        self.value = value

    def get_choices(self) -> tuple[str, ...]:
        return self.choices

    def get_type(self) -> int:
        return RADIO

    def get_readonly(self) -> bool:
        return False

    def get_name(self) -> str:
        return "shutterspeed2"


class Late(Widget):
    """A setting that reads back as before for so many looks."""

    def __init__(self, before: str, after: Widget, looks: int) -> None:
        super().__init__(after.value, *after.choices)
        self.before, self.looks = before, looks

    @property
    def value(self) -> str:
        self.looks -= 1
        return self.before if self.looks >= 0 else self.after

    @value.setter
    def value(self, value: str) -> None:
        self.after = value


class Device:
    """What libgphoto2 has for a camera: these settings, and these events. waits: in ms.

    obedience: how often capturetarget reads back as before once it was set; None for always.
    """

    def __init__(self) -> None:
        self.events: Iterator[int] = iter(())
        self.waits: list[int] = []
        self.settings = {"shutterspeed2": Widget("1/50", "1/50", "0.1s", "Bu\x1blb")}
        self.obedience: int | None = 0
        self.refuses = False
        self.open = False
        self.operations = 0
        self.refuses_parts: int | None = None
        self.stores: list[Any] | int = [Store(fields=FREE, freekbytes=3), Store(fields=0)]

    def init(self) -> None:
        self.open = True

    def exit(self) -> None:
        self.open = False

    def get_single_config(self, name: str) -> Widget:
        if name not in self.settings:
            raise LibraryError(BAD_PARAMETERS)
        known = self.settings[name]
        return Widget(known.value, *known.choices)

    def set_single_config(self, name: str, widget: Widget) -> None:
        if self.refuses:
            raise LibraryError(IO)
        if self.obedience is not None:
            self.settings[name] = Late(self.settings[name].value, widget, self.obedience)

    def trigger_capture(self) -> None:
        raise LibraryError(IO)

    def get_abilities(self) -> SimpleNamespace:
        return SimpleNamespace(operations=self.operations)

    def get_storageinfo(self) -> list[Any]:
        if isinstance(self.stores, int):
            raise LibraryError(self.stores)
        return self.stores

    def wait_for_event(self, wait_ms: int) -> tuple[int, None]:
        self.waits.append(wait_ms)
        return next(self.events, TIMEOUT), None

    def folder_list_folders(self, folder: str) -> list[tuple[str, None]]:
        """Two cards, with nothing but files on them."""
        return [("store_00010001", None), ("store_00020001", None)] if folder == "/" else []

    def folder_list_files(self, folder: str) -> list[tuple[str, None]]:
        return [] if folder == "/" else [("DSC_1.JPG", None)]

    def file_read(self, folder: str, name: str, _kind: int, offset: int, into: bytearray) -> int:
        if self.refuses_parts is not None:
            raise LibraryError(self.refuses_parts)
        part = FILES[folder, name][offset:][:3]
        into[: len(part)] = part
        return len(part)

    def file_get(self, folder: str, name: str, _kind: int) -> SimpleNamespace:
        return SimpleNamespace(get_data_and_size=lambda: memoryview(FILES[folder, name]))

    def file_get_info(self, _folder: str, _name: str) -> SimpleNamespace:
        return SimpleNamespace(file=SimpleNamespace(size=7))


@pytest.fixture
def device() -> Device:
    return Device()


@pytest.fixture
def calls(device: Device, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    library = SimpleNamespace(
        Camera=lambda: device,
        GPhoto2Error=LibraryError,
        GP_ERROR_CAMERA_BUSY=BUSY,
        GP_ERROR_IO_USB_CLAIM=-53,
        GP_ERROR_IO_LOCK=-60,
        GP_ERROR_NOT_SUPPORTED=NOT_SUPPORTED,
        GP_STORAGEINFO_FREESPACEKBYTES=FREE,
        GP_OPERATION_CAPTURE_IMAGE=IMAGE,
        GP_OPERATION_TRIGGER_CAPTURE=TRIGGER,
        GP_WIDGET_RADIO=RADIO,
        GP_WIDGET_MENU=RADIO + 1,
        GP_WIDGET_RANGE=RANGE,
        GP_FILE_TYPE_NORMAL=1,
        GP_EVENT_TIMEOUT=TIMEOUT,
        GP_EVENT_FILE_ADDED=FILE_ADDED,
        GP_EVENT_CAPTURE_COMPLETE=CAPTURE_COMPLETE,
    )
    monkeypatch.setitem(sys.modules, "gphoto2", library)
    child = importlib.import_module("drivers.gphoto.child")
    monkeypatch.setattr(child, "_TARGET_PAUSE_S", 0.0)
    yield child.Calls()
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


class Free(Widget):
    """A setting that lists no choices. value: a number for a range, as libgphoto2 has it."""

    def __init__(self, kind: int, value: Any) -> None:
        super().__init__(value)
        self.kind = kind

    def get_type(self) -> int:
        return self.kind

    def get_choices(self) -> tuple[str, ...]:
        raise LibraryError(BAD_PARAMETERS)


@pytest.mark.parametrize(
    ("widget", "value", "written"),
    [
        (Free(RANGE, 100.0), 250, [250.0]),
        (Free(RANGE, 100.0), 100, []),
        (Free(TEXT, "100"), 100, []),
        (Free(TEXT, "100"), 250, None),
        (Free(RANGE, 100.0), "auto", None),
    ],
)
def test_a_setting_without_a_list_is_written_by_number_where_it_does_not_stand_right(
    calls: Any,
    device: Device,
    monkeypatch: pytest.MonkeyPatch,
    widget: Free,
    value: Any,
    written: list[float] | None,
) -> None:
    noted: list[Any] = []
    monkeypatch.setattr(device, "get_single_config", lambda _: Free(widget.kind, widget.value))
    monkeypatch.setattr(device, "set_single_config", lambda _, set_to: noted.append(set_to.value))
    assert calls.read(SettingName.ISO).value == 100
    if written is None:
        with pytest.raises(SettingError, match=f"what iso may be: set it to {value} on the camera"):
            calls.write(SettingName.ISO, value)
    else:
        calls.write(SettingName.ISO, value)
    assert noted == (written or [])


def test_a_file_is_described_with_the_card_that_it_is_on(calls: Any) -> None:
    cards = ["/store_00010001", "/store_00020001"]
    assert calls.list_folder("/") == (set(), cards)
    assert [calls.list_folder(card) for card in (*cards, cards[0])] == [
        ({1}, []),
        ({2}, []),
        ({1}, []),
    ]
    assert [calls.describe(handle) for handle in (1, 2)] == [
        CameraObject(1, "jpeg", 7, "DSC_1.JPG", "store_00010001"),
        CameraObject(2, "jpeg", 7, "DSC_1.JPG", "store_00020001"),
    ]


@pytest.mark.parametrize(
    ("before", "choices", "after"),
    [
        ("Internal RAM", ("Internal RAM", "Memory card"), "Memory card"),
        ("sdram", ("sdram", "card", "card+sdram"), "card"),
        ("card+sdram", ("sdram", "card", "card+sdram"), "card+sdram"),
        ("Somewhere", ("Somewhere",), "Somewhere"),
    ],
)
@pytest.mark.parametrize("looks", [0, 9])
def test_photographs_go_to_the_card(
    calls: Any, device: Device, before: str, choices: tuple[str, ...], after: str, looks: int
) -> None:
    device.settings["capturetarget"] = Widget(before, *choices)
    device.obedience = looks
    calls.open("")
    assert device.settings["capturetarget"].value == after
    assert device.open


def test_a_camera_without_the_choice_is_left_alone(calls: Any, device: Device) -> None:
    device.refuses = True
    calls.open("")
    assert device.open


@pytest.mark.parametrize(
    ("refuses", "reason"), [(True, "I/O problem"), (False, "it keeps them for the computer")]
)
def test_a_camera_that_keeps_photographs_from_its_card_is_given_back(
    calls: Any, device: Device, refuses: bool, reason: str
) -> None:
    device.settings["capturetarget"] = Widget("Internal RAM", "Internal RAM", "Memory card")
    device.obedience, device.refuses = None, refuses
    with pytest.raises(SettingError) as raised:
        calls.open("")
    assert str(raised.value) == (
        f"The camera does not put its photographs onto its memory card ({reason}): insert a card, "
        "choose it in the camera's menu and try again."
    )
    assert not device.open


@pytest.mark.parametrize("stores", [NOT_SUPPORTED, [Store(fields=0)], []])
def test_a_camera_need_not_tell_the_room_on_its_card(
    calls: Any, device: Device, stores: list[Any] | int
) -> None:
    device.settings["cameramodel"] = Widget("EOS")
    device.stores = stores
    assert calls.info() == ("", "EOS", "", None, None)


def test_a_camera_tells_of_itself(calls: Any, device: Device) -> None:
    for name, value in (("manufacturer", "Canon"), ("cameramodel", "EOS"), ("batterylevel", "75%")):
        device.settings[name] = Widget(value)
    assert calls.info() == ("Canon", "EOS", "", 75, 3072)


@pytest.mark.parametrize(
    ("code", "error"), [(IO, CameraDisconnectedError), (BUSY, CameraBusyError)]
)
def test_a_camera_that_does_not_answer_is_not_taken_for_one_that_lacks_something(
    calls: Any, device: Device, code: int, error: type[DriverError]
) -> None:
    device.stores = code
    for call in (calls.info, lambda: calls.read(SettingName.ISO), calls.settings):
        with pytest.raises(error):
            call()


@pytest.mark.parametrize(
    ("method", "arguments"), [("write", (SettingName.SHUTTER_S, 0.1)), ("trigger", ())]
)
def test_a_refusal_of_a_camera_that_is_gone_is_none(
    calls: Any, device: Device, method: str, arguments: tuple[Any, ...]
) -> None:
    device.refuses = True
    with pytest.raises(LibraryError):
        getattr(calls, method)(*arguments)
    device.stores = IO
    with pytest.raises(CameraDisconnectedError):
        getattr(calls, method)(*arguments)


def test_a_setting_that_a_camera_lacks_is_told(calls: Any) -> None:
    with pytest.raises(SettingError, match="The camera has no setting iso"):
        calls.read(SettingName.ISO)


@pytest.mark.parametrize("operations", [IMAGE, TRIGGER | DELETE])
def test_a_camera_that_libgphoto2_releases_is_taken(
    calls: Any, device: Device, operations: int
) -> None:
    device.operations = operations
    calls.check_release()


def test_a_camera_whose_photographs_libgphoto2_only_fetches_is_refused(
    calls: Any, device: Device
) -> None:
    device.operations = DELETE
    with pytest.raises(SettingError, match="libgphoto2 cannot release this camera"):
        calls.check_release()


def test_a_file_is_read_in_parts(calls: Any) -> None:
    (handle,), _ = calls.list_folder("/store_00010001")
    assert [calls.chunk(handle, offset) for offset in (0, 3, 6)] == [b"012", b"345", b"6"]


def test_of_a_camera_that_gives_no_parts_a_file_is_read_whole(calls: Any, device: Device) -> None:
    device.refuses_parts = NOT_SUPPORTED
    (handle,), _ = calls.list_folder("/store_00020001")
    assert calls.chunk(handle, 0) is None
    assert calls.whole(handle) == b"abcdefg"


def test_a_part_that_fails_is_no_camera_without_parts(calls: Any, device: Device) -> None:
    device.refuses_parts = IO
    (handle,), _ = calls.list_folder("/store_00010001")
    with pytest.raises(LibraryError, match=str(IO)):
        calls.chunk(handle, 0)

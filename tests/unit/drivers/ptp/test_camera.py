from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from drivers.camera import SettingName, SettingValue
from drivers.capture import capture_pair
from drivers.clock import Clock
from drivers.errors import (
    CameraDisconnectedError,
    ProtocolError,
    SettingError,
)
from drivers.ptp.camera import PtpCamera
from drivers.ptp.codes import ContainerType, EventCode, Operation, Property, Response
from drivers.ptp.containers import Container
from drivers.ptp.datasets import DeviceInfo, Form, PropertyDescription, StorageInfo
from drivers.ptp.wire import uint, uints
from drivers.sim.body import Refusal
from drivers.sim.responder import RELEASES, Responder
from tests.unit.drivers.ptp.tampered import Tamper, Tampered, opened, photographed

BARE = DeviceInfo((0x1001, 0x1002), (), (), (), "Make", "Model", "1", "")


def test_the_camera_says_who_it_is(clock: Clock) -> None:
    info = opened(clock).info()
    assert (info.make, info.model, info.battery_percent) == (
        "NIKON CORPORATION",
        "NIKON D5100",
        87,
    )


def test_the_camera_gives_no_orders_to_a_terminal(clock: Clock) -> None:
    def hostile(_data: bytes) -> bytes:
        words = ("\x1b]0;mine\x07Make", "Mo\ndel", "1", "2\x9b")
        return DeviceInfo((0x1001, 0x1002), (), (), (), *words).encode()

    info = opened(clock, {Operation.GET_DEVICE_INFO: hostile}).info()
    assert (info.make, info.model, info.serial) == ("]0;mineMake", "Model", "2")


def test_a_camera_without_a_battery_gauge_tells_no_charge(clock: Clock) -> None:
    def without(data: bytes) -> bytes:
        info = DeviceInfo.decode(data)
        properties = tuple(code for code in info.properties if code != Property.BATTERY_LEVEL)
        return DeviceInfo(
            info.operations, info.events, properties, info.formats, "Make", "Model", "1", "2"
        ).encode()

    assert opened(clock, {Operation.GET_DEVICE_INFO: without}).info().battery_percent is None


def released_by(*operations: Operation) -> Tamper:
    """Have a camera offer these operations to release it."""

    def offering(data: bytes) -> bytes:
        info = DeviceInfo.decode(data)
        others = [code for code in info.operations if code not in RELEASES]
        return replace(info, operations=(*others, *operations)).encode()

    return offering


@pytest.mark.parametrize("operation", RELEASES)
def test_a_camera_that_offers_a_release_is_taken(clock: Clock, operation: Operation) -> None:
    opened(clock, {Operation.GET_DEVICE_INFO: released_by(operation)}).check_release()


def test_a_camera_that_offers_no_release_is_refused_with_another_way(clock: Clock) -> None:
    camera = opened(clock, {Operation.GET_DEVICE_INFO: released_by()})
    with pytest.raises(SettingError) as refusal:
        camera.check_release()
    assert str(refusal.value) == (
        "The camera takes no order to release over PTP: have libgphoto2 take its pairs, on USB by "
        "lightlayers capture gphoto2:// -o DIR, on a network with gphoto2://ptpip:HOST in place of "
        "gphoto2://."
    )


@pytest.mark.parametrize(
    "refusal",
    [Response.ACCESS_DENIED, Response.DEVICE_PROP_NOT_SUPPORTED, Response.GENERAL_ERROR],
)
def test_a_camera_that_keeps_its_charge_to_itself_tells_the_rest(
    clock: Clock, refusal: Response, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*_: object) -> None:
        raise Refusal(refusal)

    monkeypatch.setattr(Responder, "_get_device_prop_value", refused)
    info = opened(clock).info()
    assert (info.model, info.battery_percent) == ("NIKON D5100", None)


def test_settings_are_listed_in_units_for_people(clock: Clock) -> None:
    settings = {setting.name: setting for setting in opened(clock).settings()}
    assert set(settings) == set(SettingName)
    assert settings[SettingName.SHUTTER_S].value == 0.02
    assert settings[SettingName.F_NUMBER].choices == (2.8, 4, 5.6, 8, 11, 16, 22)
    assert settings[SettingName.FLASH].choices == ("off", "fill", "red_eye_fill")
    assert all(setting.writable for setting in settings.values())


def test_a_setting_that_is_named_but_not_told_now_is_none(
    clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = Responder._get_device_prop_desc

    def told(responder: Responder, code: int, *more: int) -> Any:
        if code == Property.EXPOSURE_TIME:
            raise Refusal(Response.DEVICE_PROP_NOT_SUPPORTED)
        data, parameters = whole(responder, code, *more)
        if code == Property.EXPOSURE_INDEX and data is not None:
            data = bytes(data[:2]) + uint(5, 2) + bytes(data[4:])  # of another type, with a sign
        return data, parameters

    monkeypatch.setattr(Responder, "_get_device_prop_desc", told)
    camera = opened(clock)
    lacking = {SettingName.SHUTTER_S, SettingName.ISO}
    assert {setting.name for setting in camera.settings()} == set(SettingName) - lacking
    for name in lacking:
        with pytest.raises(SettingError, match="set it on the camera itself"):
            camera.write(name, 1)
    assert capture_pair(camera, clock=clock).settings.keys() == (
        set(SettingName) - lacking - {SettingName.FLASH}
    )


def _described(maker: str, form: Form, values: tuple[int, ...], current: int) -> dict[int, Tamper]:
    """Tampers that make the camera another maker's, with other numbers of formats."""

    def described(data: bytes) -> bytes:
        plain = PropertyDescription.decode(data)
        if plain.code != Property.COMPRESSION_SETTING:
            return data
        return replace(plain, current=current, form=form, values=values).encode()

    def named(data: bytes) -> bytes:
        return replace(DeviceInfo.decode(data), manufacturer=maker).encode()

    return {Operation.GET_DEVICE_INFO: named, Operation.GET_DEVICE_PROP_DESC: described}


@pytest.mark.parametrize(
    ("number", "name"),
    [
        (0, "jpeg_basic"),
        (1, "jpeg_normal"),
        (2, "jpeg_fine"),
        (3, "raw"),
        (4, "raw+jpeg_basic"),
        (5, "raw+jpeg_normal"),
        (6, "raw+jpeg_fine"),
    ],
)
def test_formats_of_nikon_have_names(clock: Clock, number: int, name: str) -> None:
    tampers = _described("Nikon Corporation", Form.ENUMERATION, tuple(range(7)), number)
    setting = opened(clock, tampers).read(SettingName.FORMAT)
    assert (setting.value, setting.choices[number]) == (name, name)


@pytest.mark.parametrize(
    ("values", "names"),
    [
        ((0, 1, 2, 4, 5), ("jpeg_basic", "jpeg_normal", "jpeg_fine", "raw", "raw+jpeg_basic")),
        ((2, 4), ("jpeg_fine", "raw")),
        ((0, 1, 2), ("jpeg_basic", "jpeg_normal", "jpeg_fine")),
        ((3, 4, 5), ("raw", "raw+jpeg_basic", "raw+jpeg_normal")),
        ((2, 4, 6), ("0x0002", "0x0004", "0x0006")),  # neither numbering
    ],
)
def test_formats_of_older_nikons_are_told_by_their_lack_of_a_3(
    clock: Clock, values: tuple[int, ...], names: tuple[str, ...]
) -> None:
    tampers = _described("NIKON CORPORATION", Form.ENUMERATION, values, values[0])
    assert opened(clock, tampers).read(SettingName.FORMAT).choices == names


@pytest.mark.parametrize(
    ("maker", "form", "values"),
    [
        ("Make", Form.ENUMERATION, (2, 3, 6)),
        ("NIKON CORPORATION", Form.ENUMERATION, tuple(range(14))),  # numbered otherwise
        ("NIKON CORPORATION", Form.ENUMERATION, ()),
        ("NIKON CORPORATION", Form.RANGE, (0, 6, 1)),
        ("NIKON CORPORATION", Form.NONE, ()),
    ],
)
def test_formats_that_are_not_known_stay_numbers(
    clock: Clock, maker: str, form: Form, values: tuple[int, ...]
) -> None:
    camera = opened(clock, _described(maker, form, values, 3))
    assert camera.read(SettingName.FORMAT).value == "0x0003"


@pytest.mark.parametrize(
    ("value", "kinds"),
    [("raw", {"dng"}), ("jpeg_fine", {"jpeg"}), ("raw+jpeg_fine", {"dng", "jpeg"})],
)
def test_the_format_decides_what_reaches_the_card(
    clock: Clock, value: str, kinds: set[str]
) -> None:
    camera = opened(clock)
    assert camera.read(SettingName.FORMAT).value == "raw+jpeg_fine"
    camera.write(SettingName.FORMAT, value)
    before = camera.objects()
    camera.trigger()
    clock.sleep(1)
    camera.events(0)
    assert {camera.describe(handle).kind for handle in camera.objects() - before} == kinds


@pytest.mark.parametrize(
    ("name", "value"),
    [
        (SettingName.SHUTTER_S, 0.1),
        (SettingName.F_NUMBER, 5.6),
        (SettingName.ISO, 1600),
        (SettingName.FLASH, "off"),
        (SettingName.PROGRAM, "manual"),
    ],
)
def test_settings_are_written_and_read_back(
    clock: Clock, name: SettingName, value: SettingValue
) -> None:
    camera = opened(clock)
    assert camera.write(name, value).value == value
    assert camera.read(name).value == value


@pytest.mark.parametrize(
    ("offered", "value", "number"),
    [
        ((166, 200), 1 / 60, 166),
        ((167, 200), 1 / 60, 167),
        ((166, 167), 1 / 60, 167),
        ((156, 200), 1 / 64, 156),
        ((79, 80), 1 / 125, 80),
        ((12, 15, 20), 1 / 640, 15),
        ((2, 3, 4), 1 / 4000, 2),
        ((300_000, 310_000), 30, 300_000),
    ],
)
def test_times_are_taken_as_the_camera_rounds_them(
    clock: Clock, offered: tuple[int, ...], value: float, number: int
) -> None:
    current = [offered[-1]]

    def described(data: bytes) -> bytes:
        plain = PropertyDescription.decode(data)
        return replace(plain, values=offered, current=current[0]).encode()

    camera = opened(clock, {Operation.GET_DEVICE_PROP_DESC: described})
    camera._session.request = _noting(camera._session.request, current)  # type: ignore[method-assign]
    assert camera.write(SettingName.SHUTTER_S, value).value == number / 10_000
    assert current == [number]


def test_a_camera_that_offers_no_times_may_round_all_the_same(clock: Clock) -> None:
    current = [200]

    def described(data: bytes) -> bytes:
        rounded = 166 if current[0] == 167 else current[0]
        plain = PropertyDescription.decode(data)
        return replace(plain, form=Form.NONE, values=(), current=rounded).encode()

    camera = opened(clock, {Operation.GET_DEVICE_PROP_DESC: described})
    camera._session.request = _noting(camera._session.request, current)  # type: ignore[method-assign]
    assert camera.write(SettingName.SHUTTER_S, 1 / 60).value == 0.0166
    assert current == [167]


def _noting(request: Callable[..., Any], current: list[int]) -> Callable[..., Any]:
    """Note what is set in place of setting it, as the body offers other values."""

    def noted(operation: Operation, *arguments: Any, **more: Any) -> Any:
        if operation is not Operation.SET_DEVICE_PROP_VALUE:
            return request(operation, *arguments, **more)
        current[0] = int.from_bytes(more["data"], "little")
        return b"", ()

    return noted


@pytest.mark.parametrize(
    ("name", "value", "sentence"),
    [
        (SettingName.SHUTTER_S, 0.0205, "offers no shutter_s of 0.0205; it offers 0.005"),
        (SettingName.ISO, 123, "offers no iso of 123; it offers 100, 200"),
        (SettingName.FLASH, "auto", "offers no flash of auto; it offers off, fill"),
        (SettingName.FLASH, "now", "offers no flash of now; it offers off, fill"),
        (SettingName.SHUTTER_S, "bulb", "offers no shutter_s of bulb; it offers 0.005"),
        (SettingName.SHUTTER_S, 1 / 60, "offers no shutter_s of 0.01667; it offers 0.005"),
        (SettingName.FORMAT, "", "offers no format of ''; it offers "),
    ],
)
def test_values_that_the_camera_lacks_are_refused(
    clock: Clock, name: SettingName, value: SettingValue, sentence: str
) -> None:
    camera = opened(clock)
    before = camera.settings()
    with pytest.raises(SettingError, match=sentence):
        camera.write(name, value)
    assert camera.settings() == before


@pytest.mark.parametrize("value", [-5, 1 << 16])
def test_numbers_that_no_property_holds_are_refused_where_nothing_is_offered(
    clock: Clock, value: int
) -> None:
    def unlisted(data: bytes) -> bytes:
        return replace(PropertyDescription.decode(data), form=Form.NONE, values=()).encode()

    camera = opened(clock, {Operation.GET_DEVICE_PROP_DESC: unlisted})
    with pytest.raises(SettingError, match=f"{value} is not a value that iso can have"):
        camera.write(SettingName.ISO, value)


def test_a_setting_that_reads_back_otherwise_is_an_error(clock: Clock) -> None:
    def stuck(data: bytes) -> bytes:  # code, type, writable, default, then the current value
        return data[:7] + uint(2, 2) + data[9:] if data[:2] == b"\x0c\x50" else data

    camera = opened(clock, {Operation.GET_DEVICE_PROP_DESC: stuck})
    with pytest.raises(SettingError, match="told to set flash to fill but kept off"):
        camera.write(SettingName.FLASH, "fill")


def test_a_range_is_spelt_out(clock: Clock) -> None:
    def ranged(data: bytes) -> bytes:
        return data[:9] + b"\x01" + uint(400, 2) + uint(1000, 2) + uint(200, 2)

    camera = opened(clock, {Operation.GET_DEVICE_PROP_DESC: ranged})
    assert camera.read(SettingName.F_NUMBER).choices == (4, 6, 8, 10)


@pytest.mark.parametrize("step", [0, 1])
def test_a_range_too_long_to_spell_out_has_no_choices(clock: Clock, step: int) -> None:
    def ranged(data: bytes) -> bytes:
        return data[:9] + b"\x01" + uint(0, 2) + uint(0xFFFF, 2) + uint(step, 2)

    camera = opened(clock, {Operation.GET_DEVICE_PROP_DESC: ranged})
    assert camera.read(SettingName.F_NUMBER).choices == ()


def test_an_empty_slot_is_asked_for_no_photographs(clock: Clock) -> None:
    slots: dict[int, Tamper] = {
        Operation.GET_STORAGE_IDS: lambda _: uints([0x10001, 0x20000], 4),
    }
    assert opened(clock, slots).objects() == {1}


@pytest.mark.parametrize(
    ("operation", "use"),
    [
        (Operation.GET_OBJECT_HANDLES, lambda camera: camera.objects()),
        (Operation.GET_OBJECT_INFO, lambda camera: camera.describe(2)),
        (Operation.GET_DEVICE_PROP_DESC, lambda camera: camera.read(SettingName.ISO)),
        (Operation.GET_DEVICE_PROP_VALUE, lambda camera: camera.info()),
    ],
)
@pytest.mark.parametrize("tamper", [lambda _: b"", lambda data: data[: len(data) // 2]])
def test_datasets_that_end_too_early_are_refused(
    clock: Clock, operation: int, use: Callable[[PtpCamera], object], tamper: Tamper
) -> None:
    camera = photographed(clock, {operation: tamper})
    with pytest.raises(ProtocolError, match=r"ends too early.*switch the camera off"):
        use(camera)


def test_a_list_of_handles_longer_than_its_bytes_is_refused(clock: Clock) -> None:
    camera = opened(clock, {Operation.GET_OBJECT_HANDLES: lambda _: b"\xff\xff\xff\xff\x01\0\0\0"})
    with pytest.raises(ProtocolError, match="of 8 bytes ends too early"):
        camera.objects()


def test_a_camera_that_says_nonsense_of_itself_is_closed_again(clock: Clock) -> None:
    transport = Tampered(clock, {Operation.GET_DEVICE_INFO: lambda _: b"?"})
    with pytest.raises(ProtocolError, match="ends too early"):
        PtpCamera("sim://studio", transport, clock)
    with pytest.raises(CameraDisconnectedError):
        transport.receive_event(0)


def test_events_are_hints_with_handles(clock: Clock) -> None:
    camera = opened(clock)
    assert camera.events(0) == []
    camera.trigger()
    (first, second, last) = camera.events(60)
    assert [event.kind for event in (first, second, last)] == [
        "object_added",
        "object_added",
        "capture_complete",
    ]
    assert [event.handle for event in (first, second, last)] == [2, 3, None]
    assert clock.monotonic() == pytest.approx(0.22)  # exposure and writing, not the whole minute


def test_unknown_events_are_kept_as_such(clock: Clock, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("drivers.ptp.camera._EVENTS", {EventCode.OBJECT_ADDED: "object_added"})
    camera = opened(clock)
    camera.trigger()
    assert [event.kind for event in camera.events(1)][-1] == "other"


def test_events_without_end_are_taken_a_thousand_at_once(
    clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    camera = opened(clock)
    waited: list[float] = []

    def tell(wait_s: float) -> Container:
        waited.append(wait_s)
        return Container(ContainerType.EVENT, EventCode.CAPTURE_COMPLETE, 0)

    monkeypatch.setattr(camera._nikon, "can_tell", False)
    monkeypatch.setattr(camera._session.transport, "receive_event", tell)
    assert [event.kind for event in camera.events(2)] == ["capture_complete"] * 1000
    assert waited == [2] + [0] * 999


def test_a_closed_camera_answers_no_more(clock: Clock) -> None:
    with opened(clock) as camera:
        assert camera.objects() == {1}
    camera.close()
    with pytest.raises(CameraDisconnectedError, match="connect it again"):
        camera.objects()


@pytest.mark.parametrize(
    ("tampers", "free_bytes"),
    [
        ({}, 2 * 10**9),
        ({Operation.GET_STORAGE_IDS: lambda _: uints([0x10001, 0x10001], 4)}, 4 * 10**9),
        ({Operation.GET_STORAGE_IDS: lambda _: uints([0x10000], 4)}, 0),  # a slot without a card
        ({Operation.GET_STORAGE_INFO: lambda _: StorageInfo(0, 2**64 - 1, 0, "").encode()}, None),
        (
            {Operation.GET_STORAGE_INFO: lambda _: StorageInfo(0, 2**64 - 1024, 0, "").encode()},
            None,
        ),
        ({Operation.GET_DEVICE_INFO: lambda _: BARE.encode()}, None),
    ],
)
def test_room_is_told_of_all_cards_that_tell_it(
    clock: Clock, tampers: dict[int, Tamper], free_bytes: int | None
) -> None:
    assert opened(clock, tampers).info().free_bytes == free_bytes


@pytest.mark.parametrize("value", [-1, 2**16, 10**400, 1e300, float("inf"), float("nan")])
def test_a_number_that_no_property_could_hold_is_refused(clock: Clock, value: SettingValue) -> None:
    with pytest.raises(SettingError, match=r"offers no iso of .*; it offers 100, 200, 400"):
        opened(clock).write(SettingName.ISO, value)

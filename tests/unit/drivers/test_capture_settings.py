from __future__ import annotations

import math

import pytest

import drivers
from drivers.camera import (
    Setting,
    SettingName,
    SettingValue,
    meant,
)
from drivers.capture import capture_pair, write_settings
from drivers.clock import Clock
from drivers.errors import (
    SettingError,
)
from tests.unit.drivers.fake_camera import FLASH, MANUAL, FakeCamera, photograph


def test_settings_are_written_read_back_and_handed_on(clock: Clock) -> None:
    camera = FakeCamera(shots=[{"jpeg": photograph(0x10, 200)}, {"jpeg": photograph(0x09, 200)}])
    camera.set(SettingName.PROGRAM, "auto")
    camera.set(SettingName.ISO, "auto", "auto", 100, 200)
    wanted: dict[SettingName, SettingValue] = {SettingName.SHUTTER_S: 0.5, SettingName.ISO: 200}
    pair = capture_pair(camera, clock=clock, settings=wanted)
    names = [name for name, _ in camera.written]
    assert names[:5] == ["program", "focus", "drive", "shutter_s", "iso"]
    assert pair.settings == {
        name: value for name, value in (MANUAL | wanted).items() if name != SettingName.FLASH
    }
    assert pair.settings == {
        name: setting.value for name, setting in camera.table.items() if name != SettingName.FLASH
    }


def test_settings_of_a_pair_serve_another_camera_of_its_kind(clock: Clock) -> None:
    settings = capture_pair(FakeCamera(), clock=clock).settings
    other = FakeCamera()
    other.set(SettingName.SHUTTER_S, 2.0)
    assert capture_pair(other, clock=clock, settings=settings).settings == settings
    assert other.table[SettingName.SHUTTER_S].value == 0.02


def test_what_unlocks_other_settings_is_written_before_them() -> None:
    camera = FakeCamera()
    written: dict[SettingName, SettingValue] = {
        SettingName.SHUTTER_S: 0.5,
        SettingName.ISO: 200,
        SettingName.DRIVE: "single",
        SettingName.FOCUS: "manual",
        SettingName.PROGRAM: "manual",
    }
    write_settings(camera, written)
    assert camera.written == [
        ("program", "manual"),
        ("focus", "manual"),
        ("drive", "single"),
        ("shutter_s", 0.5),
        ("iso", 200),
    ]


def test_a_dial_is_not_written_where_it_stands_right_but_for_rounding() -> None:
    camera = FakeCamera()
    camera.table[SettingName.SHUTTER_S] = Setting(SettingName.SHUTTER_S, 0.0166, (), writable=False)
    write_settings(camera, {SettingName.SHUTTER_S: 1 / 60})
    assert camera.written == []
    with pytest.raises(SettingError, match="shutter_s is locked"):
        write_settings(camera, {SettingName.SHUTTER_S: 1 / 50})


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        (SettingName.FLASH, "fill", "leave the setting flash out"),
        (SettingName.PROGRAM, "auto", "A pair is taken with program manual"),
        (SettingName.DRIVE, "burst", "A pair is taken with drive single"),
        (SettingName.ISO, "auto", "a fixed iso: auto is none"),
        (SettingName.WHITE_BALANCE, "one_push", "a fixed white_balance: one_push is none"),
    ],
)
def test_settings_that_make_no_pair_are_refused_before_anything_is_written(
    clock: Clock, name: SettingName, value: SettingValue, said: str
) -> None:
    camera = FakeCamera()
    with pytest.raises(SettingError, match=said):
        capture_pair(camera, clock=clock, settings={name: value})
    assert (camera.written, len(camera.shots)) == ([], 2)


class Modal(FakeCamera):
    """A camera that offers its flash and its exposure time in manual exposure alone."""

    def write(self, name: SettingName, value: SettingValue) -> Setting:
        setting = super().write(name, value)
        if (name, value) == (SettingName.PROGRAM, "manual"):
            self.set(SettingName.FLASH, "off", "off", "fill")
            self.set(SettingName.SHUTTER_S, 0.02)
        return setting


def test_what_a_camera_offers_in_manual_exposure_counts(clock: Clock) -> None:
    camera = Modal()
    camera.set(SettingName.PROGRAM, "auto")
    camera.set(SettingName.FLASH, "auto", "auto", "off")
    del camera.table[SettingName.SHUTTER_S]
    pair = capture_pair(camera, clock=clock)
    assert pair.flash.best == FLASH
    assert pair.settings[SettingName.SHUTTER_S] == 0.02


def test_no_number_is_refused_in_words(clock: Clock) -> None:
    with (
        drivers.open_camera("sim://studio?width=64&height=64") as camera,
        pytest.raises(SettingError, match=r"offers no shutter_s of nan; it offers 0\.005"),
    ):
        capture_pair(camera, clock=clock, settings={SettingName.SHUTTER_S: math.nan})


def test_a_wanted_setting_that_only_a_dial_changes_may_stand_right_already(clock: Clock) -> None:
    camera = FakeCamera()
    camera.table[SettingName.ISO] = Setting(SettingName.ISO, 100, (), writable=False)
    assert capture_pair(camera, clock=clock, settings={SettingName.ISO: 100}).flash.best == FLASH
    with pytest.raises(SettingError, match="iso is locked"):
        capture_pair(camera, clock=clock, settings={SettingName.ISO: 200})


@pytest.mark.parametrize(
    ("value", "offered", "taken"),
    [
        (1 / 60, (0.0166, 0.02), 0.0166),
        (1 / 60, (0.0168, 0.02), 0.0168),
        (0.0165, (0.0167, 0.02), 0.0165),
        ("bulb", (0.02, "bulb"), "bulb"),
        (0.02, (), 0.02),
        (0.02, ("bulb",), 0.02),
        (float("inf"), (30,), float("inf")),
        (float("-inf"), (30,), float("-inf")),
        (10**400, (30, 0.02), 10**400),
        (-(10**400), (30,), -(10**400)),
        (0, (0.0001,), 0),
        (1 / 640, (0.0012, 0.0015, 0.002), 0.0015),  # cut to tenths of a millisecond
        (1 / 640, (1 / 500, 1 / 800), 1 / 640),
        (1 / 4000, (1 / 3200, 1 / 5000), 1 / 4000),
        (0.0003, (0.0002, 0.0004), 0.0003),
    ],
)
def test_a_time_means_the_offered_one_that_cameras_round_it_to(
    value: SettingValue, offered: tuple[SettingValue, ...], taken: SettingValue
) -> None:
    assert meant(SettingName.SHUTTER_S, value, offered) == taken


@pytest.mark.parametrize(
    ("name", "value", "offered"),
    [(SettingName.ISO, 401, (400, "auto")), (SettingName.F_NUMBER, 5.61, (5.6,))],
)
def test_other_numbers_mean_themselves(
    name: SettingName, value: SettingValue, offered: tuple[SettingValue, ...]
) -> None:
    assert meant(name, value, offered) == value


def test_a_dial_that_stands_right_but_for_rounding_is_left_alone(clock: Clock) -> None:
    camera = FakeCamera()
    camera.table[SettingName.SHUTTER_S] = Setting(SettingName.SHUTTER_S, 0.0166, (), writable=False)
    pair = capture_pair(camera, clock=clock, settings={SettingName.SHUTTER_S: 1 / 60})
    assert pair.settings[SettingName.SHUTTER_S] == 0.0166

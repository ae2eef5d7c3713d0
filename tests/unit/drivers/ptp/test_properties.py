from __future__ import annotations

import pytest

from drivers.camera import SettingName, SettingValue
from drivers.ptp.properties import CODECS


@pytest.mark.parametrize(
    ("name", "value", "number"),
    [
        (SettingName.SHUTTER_S, 0.02, 200),
        (SettingName.SHUTTER_S, 0.0125, 125),
        (SettingName.SHUTTER_S, 1, 10_000),
        (SettingName.F_NUMBER, 5.6, 560),
        (SettingName.ISO, 6400, 6400),
        (SettingName.ISO, "auto", 0xFFFF),
        (SettingName.FLASH, "off", 2),
        (SettingName.FLASH, "fill", 3),
        (SettingName.FLASH, "0x8010", 0x8010),
        (SettingName.WHITE_BALANCE, "daylight", 4),
        (SettingName.WHITE_BALANCE, "flash", 7),
        (SettingName.PROGRAM, "manual", 1),
        (SettingName.FOCUS, "manual", 1),
        (SettingName.DRIVE, "single", 1),
    ],
)
def test_values_and_numbers_translate_both_ways(
    name: SettingName, value: SettingValue, number: int
) -> None:
    assert CODECS[name].encode(value) == number
    assert CODECS[name].decode(number) == value


@pytest.mark.parametrize(
    ("name", "numbers"),
    [
        (
            SettingName.FLASH,
            ["auto", "off", "fill", "red_eye_auto", "red_eye_fill", "external"],
        ),
        (
            SettingName.WHITE_BALANCE,
            ["manual", "auto", "one_push", "daylight", "fluorescent", "tungsten", "flash"],
        ),
        (
            SettingName.PROGRAM,
            ["manual", "auto", "aperture", "shutter", "creative", "action", "portrait"],
        ),
        (SettingName.FOCUS, ["manual", "auto", "macro"]),
        (SettingName.DRIVE, ["single", "burst", "timelapse"]),
    ],
)
def test_names_have_the_numbers_of_iso_15740_which_begin_with_1(
    name: SettingName, numbers: list[str]
) -> None:
    assert [CODECS[name].decode(number) for number in range(1, len(numbers) + 1)] == numbers


def test_every_setting_has_a_property_of_its_own() -> None:
    assert set(CODECS) == set(SettingName)
    assert len({codec.code for codec in CODECS.values()}) == len(CODECS)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        (SettingName.SHUTTER_S, "long"),
        (SettingName.FLASH, "sometimes"),
        (SettingName.ISO, "high"),
        (SettingName.PROGRAM, ""),
        (SettingName.ISO, "inf"),
        (SettingName.SHUTTER_S, float("nan")),
        (SettingName.FORMAT, 16),
        (SettingName.WHITE_BALANCE, 4),
    ],
)
def test_values_that_do_not_exist_are_refused(name: SettingName, value: SettingValue) -> None:
    with pytest.raises(ValueError, match=r"could not convert|invalid literal|not finite|no name"):
        CODECS[name].encode(value)

"""Settings as people name them, and the numbers that PTP has for them."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import isfinite

from drivers.camera import SettingName, SettingValue
from drivers.ptp.codes import Property


@dataclass(frozen=True)
class Codec:
    """How a setting's value becomes a property's number.

    code: the property. unit: the size of the number 1, for numeric settings. names: number → name
    for values that are no quantity.
    """

    code: Property
    unit: float | None = None
    names: dict[int, str] = field(default_factory=dict)

    def decode(self, number: int) -> SettingValue:
        """Turn a number into a value; one without a name is given in hexadecimal."""
        if number in self.names:
            return self.names[number]
        if self.unit is None:
            return f"{number:#06x}"
        return number if self.unit == 1 else round(number * self.unit, 6)

    def encode(self, value: SettingValue) -> int:
        """Turn a value into a number. Raises ValueError for one that this setting cannot have."""
        for number, name in self.names.items():
            if value == name:
                return number
        if self.unit is not None:
            size = float(value) / self.unit
            if not isfinite(size):
                raise ValueError("not finite")
            return round(size)
        if not isinstance(value, str):  # 16 is none of the numbers, which are told as 0x0010
            raise ValueError("no name")
        return int(value, 16)


CODECS = {
    SettingName.SHUTTER_S: Codec(Property.EXPOSURE_TIME, unit=1e-4),
    SettingName.F_NUMBER: Codec(Property.F_NUMBER, unit=1e-2),
    SettingName.ISO: Codec(Property.EXPOSURE_INDEX, unit=1, names={0xFFFF: "auto"}),
    SettingName.FLASH: Codec(
        Property.FLASH_MODE,
        names={
            1: "auto",
            2: "off",
            3: "fill",
            4: "red_eye_auto",
            5: "red_eye_fill",
            6: "external",
        },
    ),
    SettingName.WHITE_BALANCE: Codec(
        Property.WHITE_BALANCE,
        names={
            1: "manual",
            2: "auto",
            3: "one_push",
            4: "daylight",
            5: "fluorescent",
            6: "tungsten",
            7: "flash",
        },
    ),
    SettingName.PROGRAM: Codec(
        Property.EXPOSURE_PROGRAM,
        names={
            1: "manual",
            2: "auto",
            3: "aperture",
            4: "shutter",
            5: "creative",
            6: "action",
            7: "portrait",
        },
    ),
    SettingName.FOCUS: Codec(Property.FOCUS_MODE, names={1: "manual", 2: "auto", 3: "macro"}),
    SettingName.DRIVE: Codec(
        Property.STILL_CAPTURE_MODE, names={1: "single", 2: "burst", 3: "timelapse"}
    ),
    SettingName.FORMAT: Codec(Property.COMPRESSION_SETTING),  # its numbers are the maker's own
}
"""One codec per setting."""

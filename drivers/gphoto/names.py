"""Settings as libgphoto2 writes them: other names and texts for every maker."""

from __future__ import annotations

import re
from fractions import Fraction

from drivers.camera import SettingName, SettingValue

WIDGETS: dict[SettingName, tuple[str, ...]] = {
    SettingName.SHUTTER_S: ("shutterspeed2", "shutterspeed"),
    SettingName.F_NUMBER: ("f-number", "aperture"),
    SettingName.ISO: ("iso",),
    SettingName.FLASH: ("flashmode",),
    SettingName.WHITE_BALANCE: ("whitebalance",),
    SettingName.PROGRAM: ("expprogram", "autoexposuremode"),
    SettingName.FOCUS: ("focusmode",),
    SettingName.DRIVE: ("capturemode", "drivemode"),
    SettingName.FORMAT: ("imagequality", "imageformat"),
}
"""What a setting is called, the better name first."""

_WORDS: dict[SettingName, dict[str, str]] = {
    SettingName.FLASH: {
        "flash off": "off",
        "off": "off",
        "fill flash": "fill",
        "fill": "fill",
        "on": "fill",
        "automatic flash": "auto",
        "auto": "auto",
        "red-eye automatic": "red_eye_auto",
        "red-eye fill": "red_eye_fill",
        "external sync": "external",
    },
    SettingName.WHITE_BALANCE: {
        "manual": "manual",
        "automatic": "auto",
        "auto": "auto",
        "daylight": "daylight",
        "fluorescent": "fluorescent",
        "tungsten": "tungsten",
        "flash": "flash",
    },
    SettingName.PROGRAM: {
        "m": "manual",
        "manual": "manual",
        "p": "auto",
        "auto": "auto",
        "a": "aperture",
        "av": "aperture",
        "s": "shutter",
        "tv": "shutter",
    },
    SettingName.FOCUS: {"manual": "manual", "mf": "manual", "automatic": "auto"},
    SettingName.DRIVE: {"single shot": "single", "single": "single", "burst": "burst"},
    SettingName.FORMAT: {
        "jpeg basic": "jpeg_basic",
        "jpeg normal": "jpeg_normal",
        "jpeg fine": "jpeg_fine",
        "nef (raw)": "raw",
        "nef+basic": "raw+jpeg_basic",
        "nef+normal": "raw+jpeg_normal",
        "nef+fine": "raw+jpeg_fine",
        "raw": "raw",
        "raw+jpeg": "raw+jpeg",
        "raw + jpeg": "raw+jpeg",
        "large fine jpeg": "jpeg_fine",
        "raw + large fine jpeg": "raw+jpeg_fine",
    },
}
_NUMBER = r"\d+(?:\.\d+)?"  # below the line, too: 1/2.5
_NUMBERS = (SettingName.SHUTTER_S, SettingName.F_NUMBER, SettingName.ISO)


def decode(name: SettingName, text: str) -> SettingValue:
    """Turn a text of libgphoto2 into a value; one that is not known stays as it can be printed."""
    text = "".join(filter(str.isprintable, text))  # it may be the camera's own
    plain = text.strip().lower()
    if name not in _NUMBERS:
        return _WORDS[name].get(plain, text)
    found = re.fullmatch(rf"(?:f/|iso )?({_NUMBER})(?:/({_NUMBER}))?\s*(?:s|sec)?", plain)
    divisor = Fraction(found[2] or 1) if found else Fraction(0)
    if not found or not divisor:
        return "auto" if "auto" in plain else text
    value = float(Fraction(found[1]) / divisor)
    return int(value) if value.is_integer() else round(value, 6)

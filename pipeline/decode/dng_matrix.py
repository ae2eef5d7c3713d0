"""How a DNG's camera sees colours: ColorMatrix, CameraCalibration and AnalogBalance.

Source: DNG specification 1.4, "Mapping Camera Color Space to CIE XYZ Space".
"""

from __future__ import annotations

import math

import numpy as np
from tifffile import TiffTags

from pipeline.arrays import Floats64
from pipeline.decode.tiff import raw_pages
from pipeline.images.frames import Matrix

_GIVEN = ((50721, 50723, 50778), (50722, 50724, 50779))
"""Tags of the two matrices, of how this camera differs from its model, and of the lights."""
_ANALOG_BALANCE = 50727
_SIGNATURES = (50931, 50932)
"""Of CameraCalibration, and of the profile that it is for; a calibration for another is left."""
_DAYLIGHT_K = 6500.0
_KELVIN = {
    1: 5500.0,
    2: 4150.0,
    3: 2850.0,
    4: 5500.0,
    9: 5500.0,
    10: 6500.0,
    11: 7500.0,
    12: 6400.0,
    13: 5050.0,
    14: 4150.0,
    15: 3525.0,
    16: 2925.0,
    17: 2850.0,
    18: 5500.0,
    19: 6500.0,
    20: 5500.0,
    21: 6500.0,
    22: 7500.0,
    23: 5000.0,
    24: 3200.0,
}
"""Temperature of each LightSource of EXIF, as Adobe's DNG SDK has it."""


def dng_matrix(data: bytes) -> Matrix | None:
    """Matrix (3, 3) from CIE XYZ to camera RGB for that light of a DNG which is nearest daylight.

    It is AnalogBalance · CameraCalibration · ColorMatrix. None for another file, or one without.
    Not checked: an entry may be infinite or no number.
    """
    try:
        with raw_pages(data) as pages:
            return _matrix(pages[0].parent.pages.first.tags)
    except Exception:  # not a TIFF, or one that only LibRaw understands
        return None


def _matrix(tags: TiffTags) -> Matrix | None:
    given = [each for each in reversed(_GIVEN) if each[0] in tags]
    if not given:
        return None
    colours, calibration, _ = min(given, key=lambda each: _off_daylight(tags, each[2]))
    matrix = _fractions(tags, colours, 9)
    if matrix is None:
        return None
    camera, profile = (tags.valueof(signature, "") for signature in _SIGNATURES)
    differs = _fractions(tags, calibration, 9) if camera == profile else None
    gains = _fractions(tags, _ANALOG_BALANCE, 3)
    matrix = matrix.reshape(3, 3)
    with np.errstate(invalid="ignore"):
        if differs is not None:
            matrix = differs.reshape(3, 3) @ matrix
        return matrix if gains is None else np.asarray(gains[:, None] * matrix)


def _off_daylight(tags: TiffTags, light: int) -> float:
    """How far the light that a tag names is from daylight, in reciprocal kelvin."""
    kelvin = _KELVIN.get(tags.valueof(light))
    return math.inf if kelvin is None else abs(1.0 / kelvin - 1.0 / _DAYLIGHT_K)


def _fractions(tags: TiffTags, code: int, count: int) -> Floats64 | None:
    """Values (count,) of a tag of fractions; None where it is missing, or has another number."""
    values = tags.valueof(code)
    if values is None or len(values) != 2 * count:
        return None
    parts = np.array(values, dtype=np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(parts[0::2] / parts[1::2])

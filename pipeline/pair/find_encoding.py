"""Tells values that are taken as linear and follow a curve such as sRGB's.

A TIFF or PNG of 16 bits that says nothing of its values is taken as linear, and many programs write
encoded ones without a profile. Then the flash part has many colours on one surface, by any ratio of
the exposures, and through the curve it has one (one_surface).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from pipeline.arrays import Floats, Floats64
from pipeline.colour.curves import srgb_to_linear
from pipeline.pair.find_exposure_ratio import (
    LEAST_HEIGHT,
    find_exposure_ratio,
    height_of,
    light_of_pairs,
)
from pipeline.pair.find_tone_curve import usual_contrasts
from pipeline.pair.ratios import Ratios
from pipeline.pair.tone_curve import ToneCurve

# Chosen on development scenes (docs/trials/values_of_files.md)
_LEAST_MEDIAN = 0.1  # of the flash photograph; where it is darker, sRGB's curve is a line
_LIKELIER = 0.6  # of the height as linear: colours that are encoded differ less, and agree more
_LEAST = 1e-9

Reading = Callable[[Floats64], Floats]
"""From the values of a file, 0…1, to light."""


def looks_encoded(ratios: Ratios, ratio: float) -> bool:
    """Whether a curve explains a pair that was read as linear.

    False where it has that ratio of the exposures as linear values. ratios: of that pair on the
    scale of a ratio that was told or taken for granted, flash photograph ÷ other.
    """
    factor = find_exposure_ratio(ratios)
    flash = ratios.no_flash * np.exp(ratios.logs) * ratio
    if factor == 1.0 or not ratios.usable.any():
        return False
    if np.median(flash[ratios.usable]) < _LEAST_MEDIAN:
        return False
    readings: list[Reading] = [
        _rec709_to_linear,
        *(partial(_srgb_to_linear, curve) for curve in usual_contrasts()),
    ]
    heights = [_height(_read(light, ratios, flash, ratio)) for light in readings]
    linear = _height(ratios, 0.0 if factor is None else float(np.log(factor)))
    return max(heights) > max(LEAST_HEIGHT, _LIKELIER * linear)


def _height(ratios: Ratios, log: float = 0.0) -> float:
    seen = light_of_pairs(ratios)
    return 0.0 if seen is None else height_of(seen[0], log)


def _read(light: Reading, ratios: Ratios, flash: Floats64, ratio: float) -> Ratios:
    """The pair in light that its values mean. flash: as it was read, on the scale of its file."""
    before, after = (
        np.maximum(light(np.clip(values, 0.0, 1.0)), _LEAST).astype(np.float64)
        for values in (ratios.no_flash, flash)
    )
    return replace(ratios, no_flash=before, logs=np.log(after / ratio / before))


def _srgb_to_linear(contrast: ToneCurve, values: Floats64) -> Floats:
    return contrast.light(srgb_to_linear(values))


def _rec709_to_linear(values: Floats64) -> Floats:
    """Rec. ITU-R BT.709-6, 1.2, as LibRaw writes without being asked for another curve."""
    return np.where(values < 0.081, values / 4.5, ((values + 0.099) / 1.099) ** (1 / 0.45))

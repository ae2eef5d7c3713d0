"""The curve of sRGB, IEC 61966-2-1."""

from __future__ import annotations

import numpy as np

from pipeline.arrays import Floats


def srgb_to_linear(values: Floats) -> Floats:
    """Code values (1.0 = white) → linear light, of the same type; below 0 it goes on as a line."""
    curve = ((np.maximum(values, 0.0) + 0.055) / 1.055) ** 2.4
    return np.where(values <= 0.04045, values / 12.92, curve).astype(values.dtype)


def linear_to_srgb(light: Floats) -> Floats:
    """Linear light (1.0 = white) → code values, of the same type; below 0 it goes on as a line."""
    curve = 1.055 * np.maximum(light, 0.0) ** (1 / 2.4) - 0.055
    return np.where(light <= 0.0031308, 12.92 * light, curve).astype(light.dtype)

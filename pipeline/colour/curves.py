"""The curve of sRGB, IEC 61966-2-1."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Values = NDArray[np.floating[Any]]


def srgb_to_linear(values: Values) -> Values:
    """Code values (1.0 = white) → linear light, of the same type; below 0 it goes on as a line."""
    curve = ((np.maximum(values, 0.0) + 0.055) / 1.055) ** 2.4
    return np.where(values <= 0.04045, values / 12.92, curve).astype(values.dtype)


def linear_to_srgb(light: Values) -> Values:
    """Linear light (1.0 = white) → code values, of the same type; below 0 it goes on as a line."""
    curve = 1.055 * np.maximum(light, 0.0) ** (1 / 2.4) - 0.055
    return np.where(light <= 0.0031308, 12.92 * light, curve).astype(light.dtype)

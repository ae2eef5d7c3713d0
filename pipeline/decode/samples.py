"""Pixels as a file holds them, before they become linear light."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Samples:
    """Decoded samples of one picture.

    values: uint8, uint16 or float32, (H, W, 3), upright unless orientation says otherwise.
    white: the code value that means 1.0.
    orientation: EXIF orientation (1–8) still to be applied.
    """

    values: NDArray[Any]
    white: float
    orientation: int = 1


def to_rgb(values: NDArray[Any]) -> NDArray[Any]:
    """(H, W), (H, W, 1–4) → (H, W, 3): grey is repeated, alpha dropped. A view where possible.

    Raises ValueError for other shapes.
    """
    if values.ndim == 2:
        values = values[..., None]
    if values.ndim != 3 or values.shape[2] not in (1, 2, 3, 4):
        raise ValueError(f"{values.shape} is no picture")
    if values.shape[2] < 3:
        return np.broadcast_to(values[..., :1], (*values.shape[:2], 3))
    return values[..., :3]


def upright(values: NDArray[Any], orientation: int) -> NDArray[Any]:
    """Turn (H, W, …) as EXIF 2.32 (tag 0x0112) says; a view, the size swapped for 5 to 8."""
    if orientation >= 5:
        values = values.swapaxes(0, 1)
    if orientation in (3, 4, 7, 8):
        values = values[::-1]
    if orientation in (2, 3, 6, 7):
        values = values[:, ::-1]
    return values

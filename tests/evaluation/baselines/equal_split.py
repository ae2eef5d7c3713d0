"""The zero of the scale: the photograph in equal parts."""

from __future__ import annotations

import numpy as np

from pipeline.arrays import Floats32
from pipeline.images.frames import Image


def equal_split(photograph: Image, count: int) -> Floats32:
    """Layers (count, H, W, 3) that each hold an equal part of the photograph."""
    return np.repeat(photograph[None] / np.float32(count), count, axis=0)

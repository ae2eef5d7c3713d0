"""The zero of the scale: the photograph in equal parts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.images.frames import Image


def equal_split(photograph: Image, count: int) -> NDArray[np.float32]:
    """Layers (count, H, W, 3) that each hold an equal part of the photograph."""
    return np.repeat(photograph[None] / np.float32(count), count, axis=0)

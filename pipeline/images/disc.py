"""A disc of pixels, by which masks are widened, closed and opened alike in all directions."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray


def disc(radius: int) -> NDArray[np.uint8]:
    """Structuring element for OpenCV, (2·radius + 1)², 1 inside and 0 outside; radius in pixels."""
    side = 2 * radius + 1
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side)), dtype=np.uint8)

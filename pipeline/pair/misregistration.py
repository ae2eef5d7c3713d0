"""What a flash photograph that lies a little beside the other does to its values."""

from __future__ import annotations

import cv2
import numpy as np

from pipeline.arrays import Floats32
from pipeline.images.frames import Image

HALO = 1
"""Rows beyond either end of a strip that registration_variance needs."""

SOFTENED_HALO = 3
"""Rows beyond either end of a strip that softened needs."""

_SOFT = 0.6  # pixels; as blurred as the interpolation of a shift by half a pixel


def registration_variance(flash: Image, deviation: float) -> Floats32:
    """Variance (h, w, 3) of values that come from a little beside where they should.

    flash: (h, w, 3) linear. deviation: standard deviation of the offset in pixels. The slope is
    half the range within a pixel's neighbourhood, which is not zero on the ridge of a line.
    """
    square = np.ones((3, 3), np.uint8)
    slope = 0.5 * (cv2.dilate(flash, square) - cv2.erode(flash, square))
    return np.asarray(np.square(np.float32(deviation) * slope), dtype=np.float32)


def softened(image: Image) -> Image:
    """Blur a photograph (h, w, 3) so that edges of two that lie beside each other still fit."""
    return np.asarray(cv2.GaussianBlur(image, (7, 7), _SOFT), dtype=np.float32)

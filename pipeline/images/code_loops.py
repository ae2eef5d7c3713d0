"""From code values to light, compiled; see pipeline.images.coded_image."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats32
from pipeline.compiling import exact


@exact
def look_up(codes: NDArray[np.uint8], table: Floats32, planes: Floats32) -> None:
    """Write the light that a table tells into planes (3, h, W)."""
    for y in range(codes.shape[0]):
        for k in range(3):
            for x in range(codes.shape[1]):
                planes[k, y, x] = table[codes[y, x, k]]


@exact
def scale(codes: NDArray[np.uint16], black: np.float32, step: np.float32, light: Floats32) -> None:
    """Write light (n,) that grows evenly with codes (n,)."""
    for i in range(len(codes)):
        light[i] = (np.float32(codes[i]) - black) * step


@exact
def scale_planes(
    codes: NDArray[np.uint16], black: np.float32, step: np.float32, planes: Floats32
) -> None:
    """The same into planes (3, h, W); a row is light before its channels are told apart."""
    width = codes.shape[1]
    light = np.empty(3 * width, np.float32)
    for y in range(codes.shape[0]):
        scale(codes[y].reshape(-1), black, step, light)
        for x in range(width):
            planes[0, y, x], planes[1, y, x] = light[3 * x], light[3 * x + 1]
            planes[2, y, x] = light[3 * x + 2]

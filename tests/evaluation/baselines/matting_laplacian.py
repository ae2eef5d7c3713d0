"""The matting Laplacian: what varies along with a picture's colours costs nothing.

Source: Levin, Lischinski and Weiss, "A Closed-Form Solution to Natural Image Matting", IEEE
Transactions on Pattern Analysis and Machine Intelligence 30(2), 2008, eq. 12.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csc_array

from pipeline.arrays import Floats64

_SIDE = 3  # of a window


def matting_laplacian(picture: Floats64, epsilon: float) -> csc_array:
    """Sparse symmetric matrix L (H·W, H·W) with αᵀ L α = 0 where α is affine in each window.

    picture: (H, W, C) with windows of 3 × 3 pixels inside. epsilon: how little slope in a window
    is preferred, in squares of the picture's units.
    """
    height, width, channels = picture.shape
    count = _SIDE**2
    numbers = np.arange(height * width).reshape(height, width)
    windows = np.lib.stride_tricks.sliding_window_view(numbers, (_SIDE, _SIDE)).reshape(-1, count)
    colours = picture.reshape(-1, channels)[windows]
    off = colours - colours.mean(axis=1, keepdims=True)
    covariance = np.einsum("wic,wid->wcd", off, off) / count
    inverse = np.linalg.inv(covariance + epsilon / count * np.eye(channels))
    alike = (1.0 + np.einsum("wic,wcd,wjd->wij", off, inverse, off)) / count
    values = np.eye(count) - alike
    rows = np.repeat(windows, count, axis=1).ravel()
    columns = np.tile(windows, (1, count)).ravel()
    return csc_array((values.ravel(), (rows, columns)), shape=(height * width, height * width))

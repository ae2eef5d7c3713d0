"""Where the lamps found cannot explain the photograph, as a picture for people."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats32
from pipeline.lamps.lamps import Lamps
from pipeline.light.shares import shares
from pipeline.pair.reduced import ReducedPair, variance_left
from pipeline.pictures.lettering import INK, Picture, panel, write, write_boxed
from pipeline.separation.proportions import predictions

MOST = 0.2
"""Relative residual at the end of the scale; fixed, so that pictures of pairs compare."""

MARKED = 0.1
"""Relative residual above which a place counts as one that the lamps do not explain."""

LEGEND = 120
"""Height of the legend below the map in pixels."""

_DEVIATIONS = 2.0  # of noise, which a weak flash makes as large as the light
_WIDTH = 900  # of the picture at least, so that the legend fits
_MOST_HEIGHT = 2048  # of a map that is enlarged
_UNUSABLE = (90, 90, 95)
_COLOURS = cv2.COLORMAP_VIRIDIS


def relative_residual(reduced: ReducedPair, lamps: Lamps) -> Floats32:
    """‖I_nf − Σ_j z_j T_j I_f‖ ÷ ‖I_nf‖ on the reduced pair, (h, w), NaN where it is not usable.

    z are the non-negative shares that come nearest, each channel weighed by lamps.channel_weights
    as when the layers are made. What two standard deviations of noise would leave is taken off (the
    flash part's noise goes through Σ z_j T_j). 0 means that the lamps explain the pixel. Three
    lamps explain all light between them, so that only light outside of their triangle leaves
    anything.
    """
    weights = lamps.channel_weights.astype(np.float32)
    predicted = predictions(reduced.flash, lamps)
    z = shares(reduced.no_flash * weights, predicted * weights)
    left = (reduced.no_flash - (z[..., None] * predicted).sum(axis=0)) * weights
    mixed = np.einsum("nhw,nkl->hwkl", z, lamps.matrices.astype(np.float32))
    variance = variance_left(
        mixed, reduced.no_flash_variance, reduced.flash_variance, reduced.covariance
    )
    noise = (variance * weights * weights).sum(axis=2)
    squared = (left * left).sum(axis=2) - np.float32(_DEVIATIONS**2) * noise
    whole = np.square(reduced.no_flash * weights).sum(axis=2)
    found = np.sqrt(np.maximum(squared, 0.0) / np.maximum(whole, 1e-12))
    return np.where(reduced.usable, found, np.nan).astype(np.float32)


def draw_residual_map(residual: Floats32) -> Picture:
    """8-bit sRGB picture of a relative residual (h, w), with a scale and words below.

    At least 900 pixels wide: smaller ones are enlarged by a whole factor, up to 2048 pixels in
    height, and what is still narrower has an empty margin to its right.
    """
    factor = max(1, min(-(-_WIDTH // residual.shape[1]), _MOST_HEIGHT // residual.shape[0]))
    codes = np.nan_to_num(np.clip(residual / MOST, 0.0, 1.0) * 255).round().astype(np.uint8)
    shown = _coloured(codes)
    shown[~np.isfinite(residual)] = _UNUSABLE
    shown = shown.repeat(factor, axis=0).repeat(factor, axis=1)
    height, width = shown.shape[:2]
    picture = panel(height + LEGEND, max(width, _WIDTH))
    picture[:height, :width] = shown
    _draw_legend(picture, height)
    return picture


def _draw_legend(picture: Picture, top: int) -> None:
    left, length, y = 24, 360, top + 44
    picture[y : y + 16, left : left + length] = _coloured(
        np.linspace(0, 255, length).round().astype(np.uint8)[None].repeat(16, axis=0)
    )
    title = "Part of each pixel's light that the lamps found do not explain"
    write(picture, title, (left, top + 28))
    for step in range(5):
        x = left + step * length // 4
        cv2.line(picture, (x, y + 16), (x, y + 21), INK, 1)
        more = " or more" if step == 4 else ""
        write_boxed(picture, f"{step * MOST / 4:.0%}{more}", (x, y + 36), picture.shape[1])
    x = left + length + 130
    cv2.rectangle(picture, (x, y), (x + 28, y + 15), _UNUSABLE, -1)
    write(picture, "not usable: clipped, transparent, moved,", (x + 40, y + 14))
    write(picture, "too dark, or no flash", (x + 40, y + 38))


def _coloured(codes: NDArray[np.uint8]) -> Picture:
    """Codes 0 … 255 (h, w) on the colour scale, RGB."""
    return np.ascontiguousarray(cv2.applyColorMap(codes, _COLOURS)[..., ::-1])

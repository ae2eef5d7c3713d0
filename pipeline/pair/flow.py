"""Motion that no homography explains: parallax of near things, and what moved by itself.

Dense inverse search, Kroeger et al., "Fast Optical Flow using Dense Inverse Search", ECCV 2016, on
edges, which flash and lamps share; taken only where it makes steps of reflectance fit.
"""

from __future__ import annotations

from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats32
from pipeline.images.area_means import area_means, size_within
from pipeline.images.frames import Image, Mask, Photograph
from pipeline.images.memory import empty_image
from pipeline.images.push_pull import push_pull
from pipeline.images.quantiles import quantile
from pipeline.images.strips import STRIP_ROWS, strips
from pipeline.pair.align import Alignment, edges
from pipeline.pair.refine import log_detail
from pipeline.threads import at_once

_LONG_SIDE = 1000  # pixels at which the flow is searched
_MOST_SIDE = 32766  # above which OpenCV does not resample by a map
_NARROWEST = 16  # shorter side, below which the search has no patches
_WINDOW = 5.0  # standard deviation of the window of local correlations, pixels
_GAIN = 0.15  # by which the correlation must rise to believe a motion
_FITS = 0.6  # correlation of what lies right
_RETURNS_PX = 0.7  # forward and back again
_MOVED_PX = 0.4  # less is within the error of the flow
_TEXTURE = 0.02  # root mean square of log steps that tell of motion, against noise
_DARK, _REACH = 0.03, 9  # of the 95th percentile; pixels that log_detail reaches
_WORTH_IT = 0.01  # share of the picture; less is chance
_CODES = 110.0  # edges run from 0 to 2
_SUM = np.ones((1, 3), np.float32)  # over channels, as a matrix


def residual_flow(no_flash: Photograph, flash: Photograph) -> Floats32 | None:
    """Find where pixels of the no-flash photograph lie in the flash photograph.

    no_flash, flash: (H, W, 3) linear, aligned but for parallax. Returns (h, w, 2) float32 of
    displacements (x, y) in pixels of the full size, on a grid that may be coarser; None where no
    notable part of the picture is explained better by any motion, or it is too narrow to tell, or
    has a side of more than 32,766 pixels, which warp_along cannot follow.
    """
    height, width = no_flash.shape[:2]
    size = size_within((width, height), _LONG_SIDE)
    if min(size) < _NARROWEST or max(height, width) > _MOST_SIDE:
        return None
    pair = at_once(partial(area_means, size=size), (no_flash, flash))
    steps = at_once(lambda image: log_detail(image) * _lit(image), pair)
    before, texture = _correlation(steps[0], steps[1])
    can_be_better = (texture > _TEXTURE) & (before < 1.0 - _GAIN)
    if _opened(can_be_better).mean() < _WORTH_IT:
        return None
    codes = [np.clip(edges(image) * _CODES, 0, 255).astype(np.uint8) for image in pair]
    forward = _search(codes[0], codes[1])
    after, _ = _correlation(steps[0], _moved(steps[1], forward))
    far = np.linalg.norm(forward, axis=2) > _MOVED_PX
    better = can_be_better & far & (after > before + _GAIN) & (after > _FITS)
    if _opened(better).mean() < _WORTH_IT:  # nor will those be enough that return as well
        return None
    backward = _search(codes[1], codes[0])
    returns = np.linalg.norm(forward + _moved(backward, forward), axis=2) < _RETURNS_PX
    moves = _opened(better & returns)
    if moves.mean() < _WORTH_IT:
        return None
    stays = ~moves & ((before > _FITS) | (texture < _TEXTURE))
    flow = np.where(moves[..., None], forward, np.float32(0.0))
    flow = push_pull(flow, (moves | stays).astype(np.float32))
    return np.asarray(
        flow / np.array([size[0] / width, size[1] / height], dtype=np.float32), dtype=np.float32
    )


def warp_along(
    image: Photograph, unusable: Mask, alignment: Alignment, flow: Floats32
) -> tuple[Image, Mask]:
    """Resample the flash frame on the no-flash frame's pixels, by homography and flow in one.

    image: (H, W, 3), at most 32,766 pixels a side, unusable: (H, W), as they were taken. flow:
    from residual_flow, of the aligned frame. Returns the image and the mask of pixels that are
    unusable or have no counterpart.
    """
    height, width = unusable.shape
    linear = image[:]
    warped = empty_image(*image.shape)
    bad = np.empty_like(unusable)
    sources = np.multiply(unusable, np.uint8(255))
    matrix = alignment.matrix.astype(np.float32)
    for rows in strips(height, STRIP_ROWS):
        x, y = (_rows_of(flow[..., axis], rows, (width, height)) for axis in (0, 1))
        x += np.arange(width, dtype=np.float32)
        y += np.arange(rows.start, rows.stop, dtype=np.float32)[:, None]
        u, v, w = (row[0] * x + row[1] * y + row[2] for row in matrix)
        u, v = u / w, v / w
        warped[rows] = cv2.remap(linear, u, v, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
        bad[rows] = cv2.remap(sources, u, v, cv2.INTER_LINEAR, borderValue=255) > 0
    return warped, bad


def _rows_of(plane: Floats32, rows: slice, full: tuple[int, int]) -> Floats32:
    """Some rows of a plane enlarged to (width, height), bilinear."""
    width, height = full
    x = (np.arange(width, dtype=np.float32) + 0.5) * (plane.shape[1] / width) - 0.5
    y = (np.arange(rows.start, rows.stop, dtype=np.float32) + 0.5) * (plane.shape[0] / height) - 0.5
    xs, ys = np.meshgrid(x, y)
    return np.asarray(
        cv2.remap(
            np.ascontiguousarray(plane), xs, ys, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
    )


def _search(reference: NDArray[np.uint8], sample: NDArray[np.uint8]) -> Floats32:
    search = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    search.setFinestScale(1)
    return np.asarray(
        search.calc(reference, sample, np.zeros((*reference.shape, 2), np.float32)),
        dtype=np.float32,
    )


def _opened(mask: Mask) -> Mask:
    """Without specks."""
    square = np.ones((5, 5), np.uint8)
    return np.asarray(cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, square) > 0)


def _moved(image: Floats32, flow: Floats32) -> Floats32:
    height, width = flow.shape[:2]
    x = flow[..., 0] + np.arange(width, dtype=np.float32)
    y = flow[..., 1] + np.arange(height, dtype=np.float32)[:, None]
    moved = cv2.remap(image, x, y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(moved, dtype=np.float32)


def _lit(image: Image) -> Floats32:
    """Where light falls (h, w, 1), 0 or 1: at its ends, steps are of light, not of reflectance."""
    light = np.asarray(cv2.transform(image, _SUM))
    dark = (light < np.float32(_DARK * quantile(light, 0.95))).astype(np.uint8)
    near = cv2.dilate(dark, np.ones((_REACH, _REACH), np.uint8))
    return np.asarray(1.0 - near, dtype=np.float32)[..., None]


def _correlation(reference: Image, sample: Image) -> tuple[Floats32, Floats32]:
    """Local correlation of steps, −1…1, and their strength in the weaker photograph, (h, w)."""
    cross, first, second = (
        cv2.GaussianBlur(cv2.transform(a * b, _SUM), (0, 0), _WINDOW)
        for a, b in ((reference, sample), (reference, reference), (sample, sample))
    )
    strength = np.sqrt(np.minimum(first, second) / 3.0)
    return np.asarray(cross / np.sqrt(first * second + 1e-12)), np.asarray(strength)

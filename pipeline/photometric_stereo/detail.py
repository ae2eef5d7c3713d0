"""Normals at the picture's own size: the fitted surface, and what each pixel's light adds to it."""

from __future__ import annotations

import cv2
import numpy as np

from pipeline.arrays import Floats, Floats32, Floats64
from pipeline.compiling import exact
from pipeline.images.frames import Image
from pipeline.images.strips import strips
from pipeline.photometric_stereo.solve import Surface
from pipeline.separation.separation import Strip

_KNOWN = 0.3  # share of the surroundings in which the surface is known
_MIN_CONFIDENCE = 0.2  # see Strip
_LIGHT_ERROR = 0.01  # of a pixel's light, and of its channels' mean
_NORMAL_ERROR, _CUT_ERROR = 0.05, 0.5  # of the surface at a reduced size, and where it was cut
_ROWS = 256  # of a depth map at a time
_MOST = 2**14  # pixels to a side at a time: cv2.remap ends at 2^15 − 2


def surface_normals(strip: Strip, surface: Surface) -> Image:
    """Unit normals (h, W, 3) of a strip: x right, y up, z to the viewer.

    NaN where nothing is known of the flash part.
    """
    height, width = strip.confidence.shape
    mask = spread(surface.mask.astype(np.float32)[..., None], surface.block, strip.rows, width)
    known = (mask[..., 0] > _KNOWN) & (strip.confidence > _MIN_CONFIDENCE)
    share: Floats32 = np.maximum(mask, np.float32(_KNOWN))

    def of_surface(field: Floats) -> Floats32:
        return spread(field, surface.block, strip.rows, width) / share

    w = of_surface(surface.w)
    if surface.block > 1 or surface.cut.any():
        cut = of_surface(surface.cut[..., None].astype(np.float32))[..., 0]
        error = np.where(cut > 0, _CUT_ERROR, _NORMAL_ERROR if surface.block > 1 else 0.0)
        lit = of_surface(surface.lit)
        deviations = of_surface(surface.deviations.reshape(*surface.mask.shape, -1))
        # pixel by pixel, however the strip lies in memory: the loop is compiled for that alone
        light = np.ascontiguousarray(strip.no_flash * of_surface(surface.correction))
        flash = np.ascontiguousarray(strip.flash)
        matrices, directions = surface.matrices, surface.directions
        _add_detail(w, error, lit, deviations, light, flash, matrices, directions)
    length = np.linalg.norm(w, axis=2, keepdims=True)
    normals = w / np.where(length > 0, length, 1.0)
    return np.where(known[..., None], normals, np.float32(np.nan)).reshape(height, width, 3)


def surface_depth(surface: Surface, size: tuple[int, int]) -> Floats32:
    """Depth (H, W) along the camera's axis, 1 in the median, NaN where it is not known.

    size: (H, W) of the picture.
    """
    field = np.stack([surface.mask, surface.z], axis=2).astype(np.float32)
    depth = np.empty(size, np.float32)
    for rows in strips(size[0], _ROWS):
        mask, z = np.moveaxis(spread(field, surface.block, rows, size[1]), 2, 0)
        depth[rows] = np.where(mask > _KNOWN, z / np.maximum(mask, _KNOWN), np.float32(np.nan))
    return depth


def spread(field: Floats, block: int, rows: slice, width: int) -> Floats32:
    """Some rows of a field (h, w, C) at the picture's own size, bilinear.

    Beyond the middles of its last pixels, as in what is left over of the picture after whole
    blocks, the field stays as it is there.
    """
    y, x = (
        (np.arange(start, stop, dtype=np.float32) + 0.5) / block - 0.5
        for start, stop in ((rows.start, rows.stop), (0, width))
    )
    planes = np.ascontiguousarray(field.transpose(2, 0, 1), dtype=np.float32)
    spread = np.empty((len(y), len(x), len(planes)), np.float32)
    for top in range(0, len(y), _MOST):
        for left in range(0, len(x), _MOST):
            part = np.s_[top : top + _MOST, left : left + _MOST]
            down = _around(y[part[0]], planes.shape[1])
            across = _around(x[part[1]], planes.shape[2])
            xs, ys = np.meshgrid(x[part[1]] - across.start, y[part[0]] - down.start)
            for channel, plane in enumerate(planes):
                spread[(*part, channel)] = cv2.remap(
                    plane[down, across],
                    xs,
                    ys,
                    cv2.INTER_LINEAR,
                    borderMode=cv2.BORDER_REPLICATE,
                )
    return spread


def _around(places: Floats, size: int) -> slice:
    """The part of an axis of this size that places along it, which rise, lie in."""
    first = np.clip(np.floor(places[0]), 0, size - 1)
    return slice(int(first), int(np.floor(places[-1])) + 2)


@exact
def _add_detail(
    w: Floats32,
    error: Floats64,
    lit: Floats32,
    deviations: Floats32,
    light: Floats32,
    flash: Floats32,
    matrices: Floats64,
    directions: Floats64,
) -> None:
    """Move w (h, W, 3) so that it explains the light, as far as the light is surer than w.

    error: (h, W), relative, of w; where it is 0 nothing moves.
    """
    a, m = np.empty((3, 3)), np.empty((3, 3))
    for y in range(w.shape[0]):
        for x in range(w.shape[1]):
            f, own = flash[y, x], w[y, x]
            squared = own[0] ** 2 + own[1] ** 2 + own[2] ** 2
            total = f[0] + f[1] + f[2]
            mean = (light[y, x, 0] + light[y, x, 1] + light[y, x, 2]) / 3
            if not (error[y, x] > 0 and squared > 0 and total > 0 and mean > 0):
                continue
            # light of channel k by w: Σ_j lit_j r_jk l_j
            for k in range(3):
                a[k] = 0.0
                for j in range(len(matrices)):
                    t = matrices[j, k]
                    r = (
                        t[0] * f[0]
                        + t[1] * f[1]
                        + t[2] * f[2]
                        + total * deviations[y, x, 3 * j + k]
                    )
                    for c in range(3):
                        a[k, c] += lit[y, x, j] * r * directions[j, c]
            m[:] = 0.0
            right = np.zeros(3)
            for c in range(3):
                m[c, c] = 1 / (error[y, x] ** 2 * squared)
            for k in range(3):
                precision = 1 / (_LIGHT_ERROR**2 * (light[y, x, k] ** 2 + mean**2))
                off = light[y, x, k]
                for c in range(3):
                    off -= a[k, c] * own[c]
                for c in range(3):
                    right[c] += precision * off * a[k, c]
                    for d in range(3):
                        m[c, d] += precision * a[k, c] * a[k, d]
            moved = np.linalg.solve(m, right)
            for c in range(3):
                w[y, x, c] += moved[c]

"""The bare mosaic of a Bayer sensor, where LibRaw would do no more to it than we do."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import rawpy
from numpy.typing import NDArray

from pipeline.arrays import Floats64
from pipeline.decode.demosaic import is_bayer
from pipeline.decode.dng_crop import Part
from pipeline.decode.dng_levels import Levels
from pipeline.decode.samples import upright
from pipeline.images.strips import STRIP_ROWS, strips


@dataclass(frozen=True)
class Mosaic:
    """What a Bayer sensor measured, upright.

    values: (H, W) uint16, LibRaw's own memory, gone when its file is closed.
    colours: (2, 2), channel of the four upper left photosites.
    black: (2, 2), what they measure without light.
    white: what they measure at white, less the least of black; as LibRaw scales its pictures.
    """

    values: NDArray[np.uint16]
    colours: NDArray[np.intp]
    black: Floats64
    white: float


def bayer_mosaic(
    raw: rawpy.RawPy,
    black_repeats: int,
    levels: Levels | None,
    part: Part | None = None,
    orientation: int = 1,
) -> Mosaic | None:
    """Mosaic of an unpacked file; None where only LibRaw knows how to make a picture of it.

    Those are sensors of other patterns, of more colours, with pixels that are not square, or that
    stand on a corner, files of pictures, and levels of black that repeat after more than
    two photosites (black_repeats), of which rawpy tells nothing. levels: a DNG's own, None where
    LibRaw's are to be taken. part: what is taken of it, before it is turned, all where None.
    orientation: EXIF's, by which to turn it. Raises rawpy's errors.
    """
    if raw.raw_type != rawpy.RawType.Flat or raw.num_colors != 3 or raw.color_desc != b"RGBG":
        return None
    values, sizes = raw.raw_image_visible, raw.sizes
    height, width = values.shape
    plain = (sizes.iheight, sizes.iwidth) == (height, width) and sizes.pixel_aspect == 1
    on_a_corner = width == height + 1  # as LibRaw lays Fuji's sensors that stand on one
    if not plain or on_a_corner or not _repeats_after_two(raw):
        return None
    if black_repeats > 2 and (levels is None or _libraw_follows(raw, levels)):
        return None
    rows, columns = part or (slice(0, height), slice(0, width))
    values = values[rows, columns]
    height, width = values.shape
    top, left = sizes.top_margin + rows.start, sizes.left_margin + columns.start
    filters = np.array(
        [
            [raw.raw_color(top + y % 2, left + x % 2) for x in range(2 + width % 2)]
            for y in range(2 + height % 2)
        ]
    )
    if levels is None:
        black = np.asarray(raw.black_level_per_channel, np.float64)[filters]
    elif _repeats(levels):
        black = levels.over(top, left, *filters.shape)[..., 0]
    else:
        values, most = _on_one_black(values, levels, top, left)
        black = np.full(filters.shape, most)
    filters, black = (upright(each, orientation)[:2, :2] for each in (filters, black))
    colours = np.where(filters == 3, 1, filters)  # both greens
    white = float(raw.white_level - black.min())
    if not is_bayer(colours) or white <= 0:
        return None
    return Mosaic(upright(values, orientation), colours, black, white)


def _libraw_follows(raw: rawpy.RawPy, levels: Levels) -> bool:
    """Whether levels that repeat are all there is, from where LibRaw's picture begins."""
    return not levels.varies and levels.repeats_from(raw.sizes.top_margin, raw.sizes.left_margin)


def _repeats(levels: Levels) -> bool:
    """Whether levels of black are those of two by two photosites."""
    return not levels.varies and max(levels.black.shape[:2]) <= 2


def _on_one_black(
    values: NDArray[np.uint16], levels: Levels, top: int, left: int
) -> tuple[NDArray[np.uint16], float]:
    """Values moved to the largest level of black among them, to whole numbers, and that level.

    top, left: where they begin in the picture with its margins.
    """
    height, width = values.shape
    most = levels.most_black()[0]
    out = np.empty_like(values)
    for rows in strips(height, STRIP_ROWS):
        part = values[rows]
        moved = part + (most - levels.over(top + rows.start, left, len(part), width)[..., 0])
        out[rows] = np.minimum(np.rint(moved), np.iinfo(np.uint16).max)
    return out, float(most)


def _repeats_after_two(raw: rawpy.RawPy) -> bool:
    try:
        pattern = raw.raw_pattern
    except NotImplementedError:  # rawpy's answer where it knows no pattern; LibRaw does those
        return False
    return pattern is not None and pattern.shape == (2, 2)

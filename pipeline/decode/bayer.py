"""The bare mosaic of a Bayer sensor, where LibRaw would do no more to it than we do."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import rawpy
from numpy.typing import NDArray

from pipeline.decode.demosaic import is_bayer
from pipeline.decode.samples import upright

ORIENTATIONS = {0: 1, 1: 2, 2: 4, 3: 3, 4: 5, 5: 8, 6: 6, 7: 7}
"""EXIF orientation by LibRaw's `flip`: mirrored across (1), down (2), rows and columns changed (4).
"""


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
    black: NDArray[np.float64]
    white: float


def bayer_mosaic(
    raw: rawpy.RawPy, black_repeats: int, orientation: int | None = None
) -> Mosaic | None:
    """Mosaic of an unpacked file; None where only LibRaw knows how to make a picture of it.

    Those are sensors of other patterns, of more colours, with pixels that are not square, or that
    stand on a corner, files of pictures, and levels of black that repeat after more than
    two photosites (black_repeats), of which rawpy tells nothing. orientation: EXIF's, by
    which to turn it; None for the file's own. Raises rawpy's errors.
    """
    if raw.raw_type != rawpy.RawType.Flat or raw.num_colors != 3 or raw.color_desc != b"RGBG":
        return None
    values, sizes = raw.raw_image_visible, raw.sizes
    height, width = values.shape
    plain = (sizes.iheight, sizes.iwidth) == (height, width) and sizes.pixel_aspect == 1
    on_a_corner = width == height + 1  # as LibRaw lays Fuji's sensors that stand on one
    if not plain or on_a_corner or black_repeats > 2 or not _repeats_after_two(raw):
        return None
    filters = np.array(
        [
            [
                raw.raw_color(sizes.top_margin + y % 2, sizes.left_margin + x % 2)
                for x in range(2 + width % 2)
            ]
            for y in range(2 + height % 2)
        ]
    )
    orientation = orientation or ORIENTATIONS[sizes.flip]
    filters = upright(filters, orientation)[:2, :2]
    colours = np.where(filters == 3, 1, filters)  # both greens
    levels = np.asarray(raw.black_level_per_channel, np.float64)
    white = float(raw.white_level - levels.min())
    if not is_bayer(colours) or white <= 0:
        return None
    return Mosaic(upright(values, orientation), colours, levels[filters], white)


def _repeats_after_two(raw: rawpy.RawPy) -> bool:
    try:
        pattern = raw.raw_pattern
    except NotImplementedError:  # rawpy's answer where it knows no pattern; LibRaw does those
        return False
    return pattern is not None and pattern.shape == (2, 2)

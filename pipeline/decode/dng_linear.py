"""The picture of a linear DNG on the scale of its own levels, where LibRaw's would be another."""

from __future__ import annotations

import numpy as np
import rawpy
from numpy.typing import NDArray

from pipeline.decode.dng_levels import Levels
from pipeline.decode.samples import UnsuitableError
from pipeline.images.strips import STRIP_ROWS, strips

_WHITE = 65535.0


def scaled(raw: rawpy.RawPy, levels: Levels) -> NDArray[np.uint16] | None:
    """Values (H, W, 3) of an unpacked linear DNG, 65535 = white; None where LibRaw's are right.

    Raises UnsuitableError where LibRaw would have to stretch the picture.
    """
    if _as_libraw_has(raw, levels):
        return None
    sizes = raw.sizes
    if sizes.pixel_aspect != 1:
        raise UnsuitableError(
            "is a DNG of oblong pixels (DefaultScale) whose levels of black or white are not read: "
            "save it as a TIFF of 16 bits."
        )
    values = raw.raw_image_visible[..., :3]
    height, width = values.shape[:2]
    span = levels.white - levels.most_black()
    out = np.empty(values.shape, np.uint16)
    for rows in strips(height, STRIP_ROWS):
        top = sizes.top_margin + rows.start
        black = levels.over(top, sizes.left_margin, len(values[rows]), width)
        light = (values[rows] - black) * (_WHITE / span)
        out[rows] = np.rint(np.clip(light, 0, _WHITE))
    return out


def _as_libraw_has(raw: rawpy.RawPy, levels: Levels) -> bool:
    """Whether LibRaw takes away the same black and divides by the same white less black."""
    theirs = np.asarray(raw.black_level_per_channel)
    black = levels.most_black()
    even = not levels.varies and (levels.black == levels.black[:1, :1]).all()
    same_white = (levels.white - black == raw.white_level - theirs.max()).all()
    return bool(even and (theirs[:3] == black).all() and same_white)

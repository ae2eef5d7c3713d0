"""The part of its picture that a DNG has programs show: DefaultCropOrigin and DefaultCropSize."""

from __future__ import annotations

import rawpy

from pipeline.decode.tiff import names_crop

Part = tuple[slice, slice]
"""Rows and columns of a picture before it is turned."""


def shown_part(raw: rawpy.RawPy, data: bytes) -> Part | None:
    """Part of LibRaw's picture of an opened file, None for all of it.

    data: the file. Only DNGs have such a part: the crops of other RAW files mean different things
    from maker to maker. Of mosaics LibRaw leaves out an odd first row and column.
    """
    sizes = raw.sizes
    height, width = sizes.height, sizes.width
    top, left = sizes.crop_top_margin - sizes.top_margin, sizes.crop_left_margin - sizes.left_margin
    bottom, right = top + sizes.crop_height, left + sizes.crop_width
    if not (0 <= top < bottom <= height and 0 <= left < right <= width):
        return None
    if (sizes.iheight, sizes.iwidth) != (height, width) or sizes.pixel_aspect != 1:
        return None  # LibRaw stretches the picture
    return (slice(top, bottom), slice(left, right)) if names_crop(data) else None

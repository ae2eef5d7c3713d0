"""A JPEG compressed once more, to tell what the first time has changed."""

from __future__ import annotations

import io

import numpy as np
import simplejpeg
from numpy.typing import NDArray
from PIL import Image as PillowImage
from PIL import JpegImagePlugin

from pipeline.compression_noise import BLOCK
from pipeline.decode.quiet import muted
from pipeline.tiles import tiles

Codes = NDArray[np.uint8]

_ASIDE = 3  # pixels; odd, so that colours that were sampled at every second pixel fall elsewhere
_ENOUGH = 500_000  # pixels
_USUAL_SAMPLING = 2  # 4:2:0


def recompressed(data: bytes, codes: Codes) -> tuple[Codes, Codes] | None:
    """Parts of a JPEG, and the same compressed again as it was, with blocks that lie elsewhere.

    data: the file. codes: (H, W, 3) RGB, its pixels as stored. Returns two (h, w, 3); None for a
    picture that is hardly larger than a block, for a large one that is lower than a tile, and where
    Pillow cannot read the header.
    """
    inner = codes[_ASIDE:, _ASIDE:]
    large = inner.shape[0] * inner.shape[1] > _ENOUGH
    before = np.ascontiguousarray(tiles(inner, _ENOUGH) if large else inner)
    if min(before.shape[:2]) < BLOCK:
        return None
    try:
        with JpegImagePlugin.JpegImageFile(io.BytesIO(data)) as header:
            # of each component: a file may number its tables as it likes, and hold others
            tables = [header.quantization[number] for *_, number in header.layer]
            sampling = JpegImagePlugin.get_sampling(header)
    except Exception:  # the decoder of the pixels judges the file, not Pillow
        return None
    rgb = simplejpeg.decode_jpeg_header(data)[2] == "RGB"
    if rgb:
        sampling = 0  # all that Pillow can write, and what others write
    elif sampling < 0:
        sampling = _USUAL_SAMPLING
    file = io.BytesIO()
    with muted():  # the encoder warns of tables that not every decoder reads
        PillowImage.fromarray(before).save(
            file, "JPEG", qtables=tables, subsampling=sampling, keep_rgb=rgb
        )
    return before, simplejpeg.decode_jpeg(file.getbuffer(), "RGB")

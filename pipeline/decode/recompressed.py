"""A picture compressed once more, to tell what the first time has changed."""

from __future__ import annotations

import io
from typing import Any, NamedTuple

import numpy as np
import simplejpeg
from numpy.typing import NDArray
from PIL import Image as PillowImage
from PIL import JpegImagePlugin

from pipeline.decode.compression_noise import BLOCK
from pipeline.decode.quiet import muted
from pipeline.images.tiles import tiles

Codes = NDArray[np.uint8]

_ASIDE = 3  # pixels; odd, so that colours that were sampled at every second pixel fall elsewhere
_ENOUGH = 500_000  # pixels
_USUAL_SAMPLING, _USUAL_QUALITY = 2, 92  # 4:2:0
# of Pillow's 4:4:4, 4:2:2, 4:2:0: what colours lose by sampling is lost once; measured:
# docs/trials/compression_noise.md
_REPEATED = ((1.0, 1.0, 1.0), (0.8, 1.0, 0.8), (0.6, 0.8, 0.6))


class Recompressed(NamedTuple):
    """Parts of a picture, and the same compressed again, with blocks that lie elsewhere.

    before, after: (h, w, 3) RGB code values. repeated: part 0…1 of the variance of what the first
    compression changed that the second one changes, of each channel in the mean.
    """

    before: Codes
    after: Codes
    repeated: tuple[float, float, float]


def recompressed(data: bytes, codes: Codes) -> Recompressed | None:
    """Compress a JPEG again.

    data: the file. codes: (H, W, 3) RGB, its pixels as stored. Returns None for a picture that is
    hardly larger than a block, for a large one that is lower than a tile, and where Pillow cannot
    read the header.
    """
    before = _parts(codes)
    if before is None:
        return None
    try:
        with JpegImagePlugin.JpegImageFile(io.BytesIO(data)) as header:
            # of each component: a file may number its tables as it likes, and hold others
            tables = [header.quantization[number] for *_, number in header.layer]
            sampling = JpegImagePlugin.get_sampling(header)
    except Exception:  # the decoder of the pixels judges the file, not Pillow
        return None
    rgb = simplejpeg.decode_jpeg_header(data, strict=False)[2] == "RGB"
    if rgb:
        sampling = 0  # all that Pillow can write, and what others write
    elif sampling < 0:
        sampling = _USUAL_SAMPLING
    return _again(before, sampling, qtables=tables, keep_rgb=rgb)


def compressed_as_jpeg(codes: NDArray[np.uint8] | NDArray[np.uint16]) -> Recompressed | None:
    """Compress a picture of HEIF as a JPEG of usual quality.

    Cameras sample the colours of both at every second pixel, which changes them most, and how
    finely HEVC coded the rest does not show in the pixels
    (docs/trials/compression_noise.md).

    codes: (H, W, 3) RGB. Returns None as recompressed does.
    """
    before = _parts(codes)
    if before is None:
        return None
    if before.dtype != np.uint8:
        before = (before >> 8).astype(np.uint8)
    return _again(before, _USUAL_SAMPLING, quality=_USUAL_QUALITY)


def _parts(codes: NDArray[Any]) -> NDArray[Any] | None:
    inner = codes[_ASIDE:, _ASIDE:]
    large = inner.shape[0] * inner.shape[1] > _ENOUGH
    before = np.ascontiguousarray(tiles(inner, _ENOUGH) if large else inner)
    return None if min(before.shape[:2]) < BLOCK else before


def _again(before: Codes, sampling: int, **settings: Any) -> Recompressed:
    file = io.BytesIO()
    with muted():  # the encoder warns of tables that not every decoder reads
        PillowImage.fromarray(before).save(file, "JPEG", subsampling=sampling, **settings)
    after = simplejpeg.decode_jpeg(file.getbuffer(), "RGB")
    return Recompressed(before, after, _REPEATED[sampling])

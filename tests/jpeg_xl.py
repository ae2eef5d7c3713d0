"""DNGs compressed as JPEG XL, made of uncompressed ones."""

from __future__ import annotations

import io
from collections.abc import Callable
from typing import Any

import imagecodecs
import numpy as np
import tifffile
from numpy.typing import NDArray

Encode = Callable[[NDArray[Any]], bytes]
_JPEG_XL = 52546


def lossless(samples: NDArray[Any]) -> bytes:
    """Encode samples (H, W) or (H, W, 3)."""
    return bytes(imagecodecs.jpegxl_encode(samples, lossless=True))


def in_jpeg_xl(
    dng: bytes,
    encode: Encode = lossless,
    bits: int | None = None,
    page: int | None = None,
    compression: int = _JPEG_XL,
) -> bytes:
    """Compress each tile or strip of an uncompressed DNG of chunky pixels, as JPEG XL or otherwise.

    bits: what BitsPerSample is to tell; None for what it tells. page: which of the sub-directories
    of the first, None for the first itself.
    """
    file = io.BytesIO(dng)
    with tifffile.TiffFile(file, mode="r+") as tiff:
        found = tiff.pages.first
        if page is not None:
            assert found.pages is not None
            found = found.pages[page].aspage()
        wide = found.tilewidth if found.is_tiled else found.imagewidth
        assert found.dtype is not None
        kind = found.dtype.newbyteorder(tiff.byteorder)
        pieces = list(zip(found.dataoffsets, found.databytecounts, strict=True))
        streams = []
        for offset, count in pieces:
            piece = np.frombuffer(dng[offset : offset + count], kind).astype(found.dtype)
            shape = (-1, wide, 3) if found.samplesperpixel == 3 else (-1, wide)
            streams.append(encode(piece.reshape(shape)))
        ends = len(dng) + np.cumsum([0, *map(len, streams)])
        kind_of_piece = "Tile" if found.is_tiled else "Strip"
        found.tags["Compression"].overwrite(compression)
        found.tags[f"{kind_of_piece}Offsets"].overwrite([int(end) for end in ends[:-1]])
        found.tags[f"{kind_of_piece}ByteCounts"].overwrite([*map(len, streams)])
        if bits is not None:
            found.tags["BitsPerSample"].overwrite([bits] * found.samplesperpixel)
    assert len(file.getvalue()) == len(dng)  # every tag has been overwritten in its place
    head = bytearray(file.getvalue())
    for offset, count in pieces:
        head[offset : offset + count] = bytes(count)  # nothing can read what is no more
    return bytes(head) + b"".join(streams)

"""TIFF: 8- and 16-bit integers and floats, and telling RAW files apart that only look like TIFF."""

from __future__ import annotations

import io
import logging
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from typing import Any

import numpy as np
from tifffile import TiffFile, TiffPage

from pipeline.decode.samples import (
    CMYK,
    Samples,
    UnsuitableError,
    refuse_grey,
    refuse_premultiplied,
    to_rgb,
    transparent,
)
from pipeline.decode.tiff_segments import segment_pixels
from pipeline.images.max_pixels import max_pixels

logging.getLogger("tifffile").setLevel(logging.CRITICAL)  # it tells the terminal of odd tags

_PHOTOMETRIC = 262
_GREY, _RGB, _YCBCR = 1, 2, 6
CFA, LINEAR_RAW = 32803, 34892
_CMYK = 5
_NO_SENSOR = (0, 3, 4, _CMYK, 8, 9, 10, 32844, 32845)
"""White as 0, palette, mask, CMYK, three kinds of Lab, and LogLuv with and without its colours."""
_SIGNED, FLOATS = 2, 3
WHITE_LEVEL = 50717
_DNG_VERSION = 50706
BLACK_REPEATS = 50713
ACTIVE_AREA = 50829
LOSSY_JPEG = 34892
"""A compression, by the number that as a kind of picture is linear raw."""
_CROP_SIZE = 50720
_REDUCED = 1
_PLANES = 2
_PREMULTIPLIED, _ALPHA = 1, 2
"""ExtraSamples of an alpha channel by which colours have been multiplied, and of one they are not.
"""
_JPEG_IN_TIFF = (6, 7)
_NO_HEADER = (1, 5, 8, 32773, 32946)
"""Compressions of bytes, not of pictures: none, LZW, Deflate, PackBits and Deflate once more."""
_EXIF = 34665
_RATIONALS = (
    "ExposureTime",
    "FNumber",
    "ShutterSpeedValue",
    "ApertureValue",
    "FocalLength",
    "FocalPlaneXResolution",
)
_NAMES = {
    "PixelXDimension": "ExifImageWidth",
    "PixelYDimension": "ExifImageLength",
    "SubsecTimeOriginal": "SubSecTimeOriginal",
}
"""Tags that exifread calls otherwise than tifffile does."""
_MAX_DIRECTORIES = 64
"""Photographs have a handful; a file of thousands is not worth the time."""


def holds_raw(data: bytes) -> bool:
    """Whether a file with a TIFF header is a RAW or DNG file, by its directories.

    A DNGVersion tag, a colour filter array or linear raw samples in any directory say so, and so
    does a file without any picture of a kind that TIFF readers show. Raises UnsuitableError where
    a full one is of a kind that no sensor gives, which LibRaw would take for a mosaic, and what
    tifffile raises.
    """
    with _opened(data) as file:
        pages = list(_pages(file))
        if any(
            page.photometric in (CFA, LINEAR_RAW) or _DNG_VERSION in page.tags for page in pages
        ):
            return True
        if any(_shows(page) for page in pages):
            return False
        for page in pages:
            if not page.subfiletype & _REDUCED:
                _refuse_no_sensor(page)
        return True


def tiff_size(data: bytes) -> tuple[int, int]:
    """(width, height) of the largest full picture, before orientation.

    Raises UnsuitableError for a grey one, ValueError, also for tiles larger than a picture may be.
    """
    with _opened(data) as file:
        page = _full(file)
        refuse_grey(page.samplesperpixel)
        if (
            page.tilewidth * page.tilelength > max_pixels()
        ):  # of which a small picture may be a part
            raise ValueError("a tile that is larger than pictures may be")
        return int(page.imagewidth), int(page.imagelength)  # a damaged tag makes them tuples


def read_tiff(data: bytes, orientation: int) -> Samples:
    """Read the largest full picture, of several alike the first.

    Raises UnsuitableError for colours that a transparency has darkened, and for a grey picture,
    ValueError and what tifffile raises.
    """
    with _opened(data) as file:
        page = _full(file)
        if 0 in page.databytecounts:
            raise ValueError("a strip without data")
        ends = map(sum, zip(page.dataoffsets, page.databytecounts, strict=False))
        if max(ends, default=0) > len(data):  # which a decoder of JPEG shows in grey
            raise ValueError("a strip goes on beyond the end")
        if page.compression not in _NO_HEADER:  # decoders believe that of the piece, not the TIFF
            places = zip(page.dataoffsets, page.databytecounts, strict=False)
            sizes = (segment_pixels(data[at : at + count]) for at, count in places)
            if max(sizes, default=0) > _most_pixels(page):
                raise ValueError("a tile or strip that is larger than it may be")
        values = page.asarray(maxworkers=1)
        if page.planarconfig == _PLANES and page.samplesperpixel > 1:
            values = np.moveaxis(values, 0, -1)
        bits, profile = page.bitspersample, page.iccprofile
        premultiplied = _PREMULTIPLIED in page.extrasamples
        empty = transparent(values) if _ALPHA in page.extrasamples else None
    white = 1.0 if values.dtype.kind == "f" else float(2**bits - 1)
    if premultiplied and values.ndim == 3:
        refuse_premultiplied(values[..., -1], white)
    values = to_rgb(values)
    if values.dtype.kind == "f":
        with np.errstate(over="ignore"):  # beyond float32 becomes infinite and is refused
            return Samples(values.astype(np.float32), white, orientation, profile, empty)
    return Samples(values, white, orientation, profile, empty)


@dataclass(frozen=True)
class Tag:
    """What a tag holds, as exifread gives it: text, or numbers."""

    values: str | tuple[Any, ...]


def tiff_tags(data: bytes) -> dict[str, Tag]:
    """Tags of the largest full picture by exifread's names; what it lacks, of the first directory.

    exifread itself knows the first directory alone, and none of BigTIFF. Raises ValueError and
    what tifffile raises.
    """
    found: dict[str, Tag] = {}
    with _opened(data) as file:
        for page in (file.pages.first, _full(file)):
            found |= {f"Image {tag.name}": _tag(tag.name, tag.value) for tag in page.tags}
            exif = page.tags.valueof(_EXIF)
            for name, value in exif.items() if isinstance(exif, dict) else ():
                found[f"EXIF {_NAMES.get(name, name)}"] = _tag(name, value)
    return found


def names_crop(data: bytes) -> bool:
    """Whether a DNG says which part of it is shown: DefaultCropSize, DNG specification 1.4."""
    try:
        with _opened(data) as file:
            return any(_CROP_SIZE in page.tags for page in _pages(file))
    except Exception:  # not a TIFF, or one that only LibRaw understands
        return False


def in_planes(data: bytes) -> bool:
    """Whether the full picture of a linear DNG has each colour in a plane of its own."""
    page = _linear_raw(data)
    return page is not None and page.planarconfig == _PLANES and page.samplesperpixel > 1


@contextmanager
def raw_pages(data: bytes) -> Iterator[list[TiffPage]]:
    """Open a file for its directories of full pictures of a sensor's or linear raw values.

    Raises what tifffile raises.
    """
    with _opened(data) as file:
        yield [
            page
            for page in _pages(file)
            if page.photometric in (CFA, LINEAR_RAW) and not page.subfiletype & _REDUCED
        ]


@contextmanager
def dng_page(data: bytes) -> Iterator[TiffPage | None]:
    """Open a file for the directory of a DNG's full picture, the largest; None for any other file.

    Not for what has been made of it, such as an enhanced picture. Raises what tifffile raises.
    """
    with _opened(data) as file:
        pages = list(_pages(file))
        full = [
            page
            for page in pages
            if page.photometric in (CFA, LINEAR_RAW) and page.subfiletype == 0
        ]
        dng = any(_DNG_VERSION in page.tags for page in pages)
        yield (
            max(full, key=lambda page: page.imagewidth * page.imagelength) if dng and full else None
        )


def linear_raw_channels(data: bytes) -> int | None:
    """Channels of the full picture of a linear DNG; None for any other file."""
    page = _linear_raw(data)
    return None if page is None else int(page.samplesperpixel)


def _linear_raw(data: bytes) -> TiffPage | None:
    """Directory of the full picture of a linear DNG, None for any other file."""
    try:
        with raw_pages(data) as pages:
            return next((page for page in pages if page.photometric == LINEAR_RAW), None)
    except Exception:  # not a TIFF, or one that only LibRaw understands
        return None


def exceeds_white(data: bytes) -> bool:
    """Whether the full picture of a DNG of floats has values above its white level, else above 1.

    Or values that are no numbers.
    False for any other file, without a look at its pixels.
    """
    try:
        with raw_pages(data) as pages:
            for page in pages:
                if page.sampleformat == FLOATS:
                    white = np.max(page.tags.valueof(WHITE_LEVEL, 1))
                    return not page.asarray(maxworkers=1).max() <= white  # nor is NaN
    except Exception:  # not a TIFF, or one that only LibRaw understands
        return False
    return False


def black_repeats(data: bytes) -> int:
    """Rows or columns, whichever are more, after which a DNG's levels of black repeat; else 1.

    BlackLevelRepeatDim of the DNG specification 1.4.
    """
    try:
        with _opened(data) as file:
            return max(
                int(part)
                for page in _pages(file)
                for part in page.tags.valueof(BLACK_REPEATS, (1,))
            )
    except Exception:  # not a TIFF, or one that only LibRaw understands
        return 1


def _most_pixels(page: TiffPage) -> float:
    """Most pixels that a tile or strip may have by its own header, of the picture's or a tile's.

    Some JPEGs have more than the TIFF shows of them, which are cropped.
    """
    if page.compression in _JPEG_IN_TIFF:
        return max_pixels()
    tile = page.tilewidth * page.tilelength if page.is_tiled else 0
    return max(tile, page.imagewidth * page.imagelength)


def _tag(name: str, value: Any) -> Tag:
    """Make a tag of what tifffile gives: a number alone or several, of rationals both parts."""
    if isinstance(value, str):
        return Tag(value)
    values = value if isinstance(value, tuple) else (value,)
    if name in _RATIONALS and len(values) == 2:
        return Tag((values[0] / values[1] if values[1] else None,))
    return Tag(values)


@contextmanager
def _opened(data: bytes) -> Iterator[TiffFile]:
    """Open a file that does not outlive the block: what tifffile makes of it refers to itself."""
    with io.BytesIO(data) as memory, TiffFile(memory) as file:
        yield file


def _pages(file: TiffFile) -> Iterator[TiffPage]:
    """Walk the first directories with their sub-directories, in the order of the file."""
    for page in islice(file.pages, _MAX_DIRECTORIES):
        page = page.aspage()
        yield page
        for child in islice(page.pages or (), _MAX_DIRECTORIES):
            yield child.aspage()


def _shows(page: TiffPage) -> bool:
    if page.photometric not in (_GREY, _RGB, _YCBCR) or page.dtype is None:
        return False
    if page.photometric == _YCBCR and page.compression not in _JPEG_IN_TIFF:
        return False  # tifffile turns only JPEG's YCbCr into RGB
    if page.imagedepth != 1 or page.samplesperpixel > 4:
        return False
    return page.dtype.kind == "f" or page.dtype in (np.uint8, np.uint16)


def _refuse_no_sensor(page: TiffPage) -> None:
    """Raise UnsuitableError for a picture whose tags say that it is of no sensor."""
    kind = page.tags.valueof(_PHOTOMETRIC)  # tifffile itself takes white as 0 where it is missing
    if kind == _CMYK:
        raise UnsuitableError(CMYK)
    if kind in _NO_SENSOR or page.sampleformat == _SIGNED:
        raise UnsuitableError(
            "is a TIFF of a kind that is not read: send one with 8-bit, 16-bit or float RGB values."
        )


def _full(file: TiffFile) -> TiffPage:
    """Directory of the largest full picture: some programs put a small one first, and unnamed."""
    full = [page for page in _pages(file) if _shows(page) and not page.subfiletype & _REDUCED]
    if not full:
        raise ValueError("no full picture")
    return max(full, key=_rank)


def _rank(page: TiffPage) -> tuple[bool, int]:
    """Colours go before a grey mask, then the larger. Raises TypeError for a damaged size."""
    return page.samplesperpixel > 2, int(page.imagewidth) * int(page.imagelength)

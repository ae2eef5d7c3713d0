"""DNGs whose samples lie in the file as LibRaw does not look for them: refused, with what to do.

Sources: DNG specification 1.7.1; TIFF 6.0. What LibRaw does of each was tried out.
"""

from __future__ import annotations

from itertools import pairwise

from tifffile import TiffPage

from pipeline.decode.jpeg_header import EXTENDED, WITHOUT_LOSS, frame
from pipeline.decode.samples import UnsuitableError
from pipeline.decode.tiff import ACTIVE_AREA, CFA, FLOATS, LOSSY_JPEG, dng_page

_NONE, _JPEG = 1, 7
_INTERLEAVED = (50975, 52547)
_PATTERN_SIZE = 33421
_PLANE_COLOURS, _LAYOUT = 50710, 50711
_RGB = (0, 1, 2)
_LAYOUTS = (1, 2)
"""Of photosites in a rectangle, and on a corner."""
_PATTERN_ROWS = (2, 4, 8, 16)
_X_TRANS = (6, 6)
_START = b"\xff\xd8"
_HEADER = 2**16
"""Bytes of a JPEG in which its frame is told."""


def refuse_laid_out(data: bytes) -> None:
    """Raise UnsuitableError for a DNG of which LibRaw would take other samples for a pixel's.

    Not for any other file, nor for one that only LibRaw understands. Raises ValueError where a JPEG
    does not begin where it should, of which LibRaw would leave a black tile.
    """
    damaged, reason = False, None
    try:
        with dng_page(data) as page:
            if page is not None:
                damaged = page.compression == _JPEG and not _begin(page, data)
                reason = _reason(page, data)
    except Exception:  # not a TIFF, or a damaged one, for LibRaw to judge
        return
    if damaged:
        raise ValueError("a tile without its beginning")
    if reason is not None:
        raise UnsuitableError(
            f"is a DNG that has {reason}, which is not read: save it anew with a DNG converter, "
            "or as a TIFF of 16 bits."
        )


def _reason(page: TiffPage, data: bytes) -> str | None:
    lossy = page.compression == LOSSY_JPEG
    if page.is_tiled and page.tilewidth > page.imagewidth and not lossy:
        return "tiles wider than its picture (TileWidth)"
    uneven = page.is_tiled and page.imagewidth % page.tilewidth
    if uneven and page.sampleformat == FLOATS and page.compression == _NONE:
        return "tiles of floats beyond the edge of its picture (TileWidth)"
    if not page.is_tiled and len(page.dataoffsets) > 1:
        if page.compression in (_JPEG, LOSSY_JPEG):
            return "strips of JPEG (RowsPerStrip)"
        if page.compression == _NONE and not _follow(page):
            return "strips that do not follow one another (StripOffsets)"
    if any(page.tags.valueof(tag, 1) != 1 for tag in _INTERLEAVED):
        return "rows or columns sorted by fields (RowInterleaveFactor, ColumnInterleaveFactor)"
    whole = (0, 0, page.imagelength, page.imagewidth)
    if lossy and page.tags.valueof(ACTIVE_AREA, whole) != whole:
        return "margins around a lossy picture (ActiveArea)"
    if page.compression == _JPEG and not _unpacked(page, data):
        return "tiles or strips that are no JPEG without loss (Compression)"
    return _mosaic_reason(page) if page.photometric == CFA else None


def _mosaic_reason(page: TiffPage) -> str | None:
    if page.tags.valueof(_LAYOUT, 1) not in _LAYOUTS:
        return "photosites that stand in no rectangle (CFALayout)"
    if tuple(page.tags.valueof(_PLANE_COLOURS, _RGB)) != _RGB:
        return "colours in another order (CFAPlaneColor)"
    size = tuple(page.tags.valueof(_PATTERN_SIZE, (2, 2)))
    if size != _X_TRANS and not (size[0] in _PATTERN_ROWS and size[1] == 2):
        return f"a colour pattern of {size[0]} × {size[1]} photosites (CFARepeatPatternDim)"
    return None


def _begin(page: TiffPage, data: bytes) -> bool:
    return all(data.startswith(_START, at) for at in page.dataoffsets)


def _follow(page: TiffPage) -> bool:
    """Whether each strip begins where the rows of the one before end."""
    row = -(-page.imagewidth * page.samplesperpixel * page.bitspersample // 8)
    steps = (after - before for before, after in pairwise(page.dataoffsets))
    return all(step == row * page.rowsperstrip for step in steps)


def _unpacked(page: TiffPage, data: bytes) -> bool:
    """Whether all tiles or strips are JPEGs that LibRaw unpacks to the picture's samples."""
    frames = {frame(data[at : at + _HEADER]) for at in page.dataoffsets}
    if page.photometric == CFA:  # laid out as one colour or more, also with loss
        return all(found and found[0] in (WITHOUT_LOSS, EXTENDED) for found in frames)
    return frames == {(WITHOUT_LOSS, page.samplesperpixel)}

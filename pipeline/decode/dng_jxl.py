"""DNGs compressed as JPEG XL, made uncompressed, which LibRaw reads.

Sources: DNG specification 1.7.1 (Compression 52546, RowInterleaveFactor, ColumnInterleaveFactor);
TIFF 6.0.
"""

from __future__ import annotations

import io
import math
import struct
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

import imagecodecs
import numpy as np
from numpy.typing import NDArray
from tifffile import TiffPage

from pipeline.decode.dng_curves import OPCODE_LIST_2, curves
from pipeline.decode.dng_values import LINEARIZATION
from pipeline.decode.jxl_header import jxl_samples
from pipeline.decode.samples import UnsuitableError
from pipeline.decode.tiff import FLOATS, WHITE_LEVEL, raw_pages

_JPEG_XL, _NONE = 52546, 1
_BITS, _COMPRESSION, _PREDICTOR = 258, 259, 317
_STRIP_OFFSETS, _STRIP_ROWS, _STRIP_BYTES = 273, 278, 279
_TILE_WIDTH, _TILE_LENGTH, _TILE_OFFSETS, _TILE_BYTES = 322, 323, 324, 325
_ROW_INTERLEAVE, _COLUMN_INTERLEAVE = 50975, 52547
_SHORT, _LONG, _UNDEFINED = 3, 4, 7
"""Types of tags."""
_MOST_BYTES = 2**31
"""Of samples; LibRaw unpacks no more."""


@dataclass(frozen=True)
class _Picture:
    """What the directory of a full picture says of its samples.

    size: (height, width). tile: the same of a tile or strip. kind: of the samples that are written.
    bits: of those that are meant. pieces: (offset, bytes) of each tile or strip. fields: into how
    many parts rows and columns are sorted. order: "<" or ">". entries: tag → its place in the file.
    bits_at: where BitsPerSample has its values. curves: tables (3, 65536) that samples go through.
    """

    size: tuple[int, int]
    channels: int
    kind: np.dtype[Any]
    bits: int
    tile: tuple[int, int]
    in_strips: bool
    pieces: tuple[tuple[int, int], ...]
    fields: tuple[int, int]
    order: str
    entries: dict[int, int]
    bits_at: int
    curves: NDArray[np.uint16] | None

    @property
    def shape(self) -> tuple[int, int, int]:
        return (*self.size, self.channels)

    @property
    def bytes(self) -> int:
        return math.prod(self.shape) * self.kind.itemsize


def described(data: bytes) -> bytes:
    """Give a DNG whose full picture is JPEG XL as uncompressed would have it, without its samples.

    Its header tells LibRaw what it needs. Other files are given as they are. Raises
    UnsuitableError for one that uncompressed does not take, ValueError for a damaged one.
    """
    picture = _picture(data)
    if picture is None:
        return data
    file = io.BytesIO(data)
    _describe(file, picture, _end(data))
    return file.getvalue()


def uncompressed(data: bytes) -> bytes:
    """Give a DNG whose full picture is JPEG XL with the same samples uncompressed at its end.

    All else is as it was, but that the polynomials of a lossy one are followed, and are there no
    more. Integers are those that BitsPerSample, the table and the white level are for: 16 bits
    where these tell 10 are numbers up to 1023, and fewer bits than they tell are stretched to
    them. Other files are given as they are. Raises UnsuitableError for other than 1 or 3 channels
    and for one whose white nothing tells, ValueError and imagecodecs.JpegxlError for a damaged one.
    """
    picture = _picture(data)
    if picture is None:
        return data
    _check_pieces(picture)
    file = io.BytesIO(data)
    at = _end(data)
    _describe(file, picture, at)
    file.seek(at + picture.bytes - 1)
    file.write(b"\0")
    _fill(file.getbuffer()[at:], picture, data)  # in place: a phone's picture takes 300 MB
    return file.getvalue()


def _end(data: bytes) -> int:
    """Where something may be added to a TIFF: at even places."""
    return len(data) + len(data) % 2


def _picture(data: bytes) -> _Picture | None:
    """Directory of the full picture of a DNG in JPEG XL; None for any other file."""
    with ExitStack() as opened:  # until all is read: tifffile leaves large tags in the file
        try:
            pages = opened.enter_context(raw_pages(data))
            page = next((page for page in pages if _is_jpeg_xl(page)), None)
        except Exception:  # not a TIFF, or one that only LibRaw understands
            return None
        return None if page is None else _checked(page)


def _is_jpeg_xl(page: TiffPage) -> bool:
    full = page.subfiletype == 0  # not one that has been made of it
    return full and page.compression == _JPEG_XL and not page.parent.is_bigtiff


def _checked(page: TiffPage) -> _Picture:
    height, width = int(page.imagelength), int(page.imagewidth)
    channels, bits = int(page.samplesperpixel), int(page.bitspersample)
    if channels not in (1, 3):
        raise UnsuitableError(
            f"is a DNG in JPEG XL of {channels} channels, which is not read: save it as an "
            "uncompressed or lossless DNG, or as a TIFF."
        )
    kind = _kind(page.sampleformat == FLOATS, bits)
    if (page.tags[_BITS].dtype, page.tags[_BITS].count) != (_SHORT, channels):
        raise ValueError("other bits than the channels have")
    if bits != 8 * kind.itemsize and WHITE_LEVEL not in page.tags:
        raise UnsuitableError(
            "is a DNG in JPEG XL that does not tell its white level: save it as an uncompressed or "
            "lossless DNG, or as a TIFF."
        )
    tile = (page.tilelength, page.tilewidth) if page.is_tiled else (page.rowsperstrip, width)
    rows, columns = (min(int(side), _MOST_BYTES) for side in tile)
    if not page.is_tiled:
        rows = min(rows, height)
    factors = (page.tags.valueof(tag, 1) for tag in (_ROW_INTERLEAVE, _COLUMN_INTERLEAVE))
    by_rows, by_columns = map(int, factors)
    if min(height, width, rows, columns, by_rows, by_columns) < 1:
        raise ValueError("a size that cannot be")
    return _Picture(
        size=(height, width),
        channels=channels,
        kind=kind.newbyteorder(page.parent.byteorder),
        bits=_meant_bits(page, bits, 8 * kind.itemsize),
        tile=(rows, columns),
        in_strips=not page.is_tiled,
        pieces=tuple(zip(page.dataoffsets, page.databytecounts, strict=True)),
        fields=(by_rows, by_columns),
        order=page.parent.byteorder,
        entries={tag.code: tag.offset for tag in page.tags},
        bits_at=page.tags[_BITS].valueoffset,
        curves=curves(page),
    )


def _meant_bits(page: TiffPage, told: int, most: int) -> int:
    """Bits told, or the most where the table or else the white level goes on beyond these."""
    table = page.tags.valueof(LINEARIZATION)
    last = np.max(page.tags.valueof(WHITE_LEVEL, 0)) if table is None else len(table) - 1
    return told if last < 2**told else most


def _check_pieces(picture: _Picture) -> None:
    """Raise ValueError where tiles or strips do not make the picture, or would be too much."""
    (height, width), (rows, columns) = picture.size, picture.tile
    down, across = -(-height // rows), -(-width // columns)
    samples = down * rows * across * columns * picture.channels
    if len(picture.pieces) != down * across or samples * picture.kind.itemsize > _MOST_BYTES:
        raise ValueError("other tiles than the size of the picture asks for")


def _describe(file: io.BytesIO, picture: _Picture, at: int) -> None:
    """Have the directory tell of one uncompressed tile or strip that begins at a place."""
    height, width, channels = picture.shape
    short = {_COMPRESSION: _NONE, _PREDICTOR: 1, _ROW_INTERLEAVE: 1, _COLUMN_INTERLEAVE: 1}
    long = {
        _STRIP_OFFSETS: at,
        _STRIP_ROWS: height,
        _STRIP_BYTES: picture.bytes,
        _TILE_WIDTH: width,
        _TILE_LENGTH: height,
        _TILE_OFFSETS: at,
        _TILE_BYTES: picture.bytes,
    }
    for tag, entry in picture.entries.items():
        file.seek(entry)
        if tag in short:
            file.write(struct.pack(f"{picture.order}HHIHH", tag, _SHORT, 1, short[tag], 0))
        elif tag in long:
            file.write(struct.pack(f"{picture.order}HHII", tag, _LONG, 1, long[tag]))
        elif tag == OPCODE_LIST_2 and picture.curves is not None:
            file.write(struct.pack(f"{picture.order}HHII", tag, _UNDEFINED, 4, 0))  # none are left
    file.seek(picture.bits_at)
    bits = [8 * picture.kind.itemsize] * channels
    file.write(struct.pack(f"{picture.order}{channels}H", *bits))


def _fill(memory: memoryview, picture: _Picture, data: bytes) -> None:
    """Decode the tiles or strips of a file into the place of its samples."""
    samples = np.frombuffer(memory, picture.kind).reshape(picture.shape)
    rows, columns = map(_places, picture.size, picture.fields)
    for (top, left), stream in _pieces(picture, data):
        into = rows[top : top + picture.tile[0]], columns[left : left + picture.tile[1]]
        height = len(into[0]) if picture.in_strips else picture.tile[0]
        tile = _decoded(stream, (height, picture.tile[1], picture.channels), picture)
        samples[np.ix_(*into)] = tile[: len(into[0]), : len(into[1])]


def _places(side: int, fields: int) -> NDArray[np.intp]:
    """Row or column of the picture of each stored one: the first of each field, then the second."""
    if fields >= side:
        fields = 1
    return np.concatenate([np.arange(first, side, fields) for first in range(fields)])


def _pieces(picture: _Picture, data: bytes) -> Iterator[tuple[tuple[int, int], bytes]]:
    """Walk (top, left) and the stream of each tile or strip."""
    rows, columns = picture.tile
    across = -(-picture.size[1] // columns)
    for index, (offset, count) in enumerate(picture.pieces):
        stream = data[offset : offset + count]
        if len(stream) < count:
            raise ValueError("a tile goes on beyond the end")
        yield (rows * (index // across), columns * (index % across)), stream


def _decoded(stream: bytes, shape: tuple[int, int, int], picture: _Picture) -> NDArray[Any]:
    """Samples of a tile, (H, W, channels), on the scale of the picture's bits."""
    bits, floats = jxl_samples(stream)
    kind = _kind(floats, bits)
    if kind.kind != picture.kind.kind or kind.itemsize > picture.kind.itemsize:
        raise ValueError("other samples than the directory tells")
    tile = np.empty(shape, kind)
    imagecodecs.jpegxl_decode(stream, out=tile[..., 0] if shape[2] == 1 else tile)
    if not floats and bits < picture.bits:
        stretched = tile * ((2**picture.bits - 1) / (2**bits - 1))
        tile = np.rint(stretched).astype(np.uint16)
    if picture.curves is not None:
        tile = np.stack([table[tile[..., c]] for c, table in enumerate(picture.curves)], axis=-1)
    return tile


def _kind(floats: bool, bits: int) -> np.dtype[Any]:
    """Smallest samples of so many bits that TIFF and libjxl have. Raises ValueError for more."""
    kinds = (np.float16, np.float32) if floats else (np.uint8, np.uint16)
    for kind in map(np.dtype, kinds):
        if 0 < bits <= 8 * kind.itemsize:
            return kind
    raise ValueError(f"samples of {bits} bits")

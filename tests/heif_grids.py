"""HEIF files as phones write them: a picture in tiles, each coded by itself."""

from __future__ import annotations

import io
import struct
from itertools import product

import numpy as np
import pillow_heif
from numpy.typing import NDArray

from pipeline.decode.boxes import box, boxes

Codes = NDArray[np.uint8]


def heif_grid(codes: Codes, tile: int = 64, quarter_turns: int = 0) -> bytes:
    """A picture (h, w, 3) in tiles of that many pixels; quarter_turns: to the left, to show it."""
    height, width, _ = codes.shape
    rows, columns = -(-height // tile), -(-width // tile)
    bottom, right = rows * tile - height, columns * tile - width
    whole = np.pad(codes, ((0, bottom), (0, right), (0, 0)), "edge")
    corners = product(range(0, rows * tile, tile), range(0, columns * tile, tile))
    tiles = [coded(whole[y : y + tile, x : x + tile]) for y, x in corners]
    grid = len(tiles) + 1
    properties = [
        _full(b"ispe", struct.pack(">II", tile, tile)),
        _full(b"ispe", struct.pack(">II", width, height)),
        _box(b"irot", bytes([quarter_turns])),
        _box(b"colr", b"nclx" + struct.pack(">HHHB", 1, 13, 6, 0x80)),
        *(_box(b"hvcC", configuration) for configuration, _ in tiles),
    ]
    assigned = [
        *(struct.pack(">HBBBB", item, 3, 1, 4, 4 + item | 0x80) for item in range(1, grid)),
        struct.pack(">HBBBB", grid, 3, 2, 4, 3 | 0x80),
    ]
    infos = [_info(item, b"hvc1") for item in range(1, grid)] + [_info(grid, b"grid")]
    parts = struct.pack(f">HH{len(tiles)}H", grid, len(tiles), *range(1, grid))
    grid_data = struct.pack(">BBBBHH", 0, 0, rows - 1, columns - 1, width, height)

    def meta(start: int) -> bytes:
        sizes = [len(data) for _, data in tiles]
        starts = start + np.cumsum([0, *sizes[:-1]])
        places = [
            struct.pack(">HHHHII", item, 0, 0, 1, *place)
            for item, place in enumerate(zip(starts, sizes, strict=True), 1)
        ]
        places.append(struct.pack(">HHHHII", grid, 1, 0, 1, 0, len(grid_data)))
        return _full(
            b"meta",
            _full(b"hdlr", bytes(4) + b"pict" + bytes(13)),
            _full(b"pitm", struct.pack(">H", grid)),
            _full(b"iinf", struct.pack(">H", grid), *infos),
            _full(b"iref", _box(b"dimg", parts)),
            _box(
                b"iprp",
                _box(b"ipco", *properties),
                _full(b"ipma", struct.pack(">I", grid), *assigned),
            ),
            _box(b"idat", grid_data),
            _full(b"iloc", b"\x44\0", struct.pack(">H", grid), *places, version=1),
        )

    first = _box(b"ftyp", b"heic", bytes(4), b"mif1heic")
    start = len(first) + len(meta(0)) + 8
    return first + meta(start) + _box(b"mdat", *(data for _, data in tiles))


def coded(codes: Codes) -> tuple[bytes, bytes]:
    """The decoder's configuration (what is in `hvcC`) of a picture coded alone, and its data."""
    file, (height, width, _) = io.BytesIO(), codes.shape
    image = pillow_heif.from_bytes("RGB", (width, height), codes.tobytes())
    image.save(file, quality=90, chroma=420)
    meta = box(file.getvalue(), b"meta")[4:]
    data = next(content for name, content in boxes(file.getvalue()) if name == b"mdat")
    return box(box(box(meta, b"iprp"), b"ipco"), b"hvcC"), data


def _box(name: bytes, *parts: bytes) -> bytes:
    content = b"".join(parts)
    return struct.pack(">I", 8 + len(content)) + name + content


def _full(name: bytes, *parts: bytes, version: int = 0) -> bytes:
    return _box(name, struct.pack(">I", version << 24), *parts)


def _info(item: int, kind: bytes) -> bytes:
    return _full(b"infe", struct.pack(">HH", item, 0), kind, b"\0", version=2)

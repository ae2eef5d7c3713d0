"""Pictures in tiles, as phones write them, whole and with parts missing."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.colour.curves import linear_to_srgb
from pipeline.decode import decode, read_header
from pipeline.decode.heif_parts import is_complete
from pipeline.errors import InputError
from tests.heif_grids import coded, heif_grid

_TILE = 64


@pytest.fixture(scope="module")
def codes() -> NDArray[np.uint8]:
    y, x = np.mgrid[:150, :210]
    waves = [128 + 100 * np.sin(x / 30 + k) * np.cos(y / 25) for k in range(3)]
    return np.stack(waves, axis=-1).astype(np.uint8)


@pytest.fixture(scope="module")
def grid(codes: NDArray[np.uint8]) -> bytes:
    return heif_grid(codes, _TILE)


@pytest.fixture(scope="module")
def place(codes: NDArray[np.uint8], grid: bytes) -> slice:
    """Where the sixth tile's data are in the file: 64 to 128 pixels down, 64 to 128 across."""
    _, data = coded(codes[_TILE : 2 * _TILE, _TILE : 2 * _TILE])
    assert grid.count(data) == 1
    start = grid.index(data)
    return slice(start, start + len(data))


@pytest.mark.parametrize("quarter_turns", range(4))
def test_tiles_are_laid_together_and_turned(quarter_turns: int, codes: NDArray[np.uint8]) -> None:
    data = heif_grid(codes, _TILE, quarter_turns)
    expected = np.rot90(codes, quarter_turns)
    assert read_header(data).size == expected.shape[1::-1]
    frame = decode(data)
    assert frame.encoding == "srgb"
    shown = 255 * linear_to_srgb(frame.pixels[:])
    np.testing.assert_allclose(shown, expected, atol=8)
    assert np.abs(shown - expected).mean() < 1


def _holed(grid: bytes, place: slice) -> bytes:
    middle = (place.start + place.stop) // 2
    return grid[:middle] + bytes(place.stop - middle) + grid[place.stop :]


def _empty(grid: bytes, place: slice) -> bytes:
    return grid[: place.start] + bytes(place.stop - place.start) + grid[place.stop :]


def _other_place(grid: bytes, place: slice, start: int, length: int) -> bytes:
    told = struct.pack(">II", place.start, place.stop - place.start)
    assert grid.count(told) == 1
    return grid.replace(told, struct.pack(">II", start, length))


def _cut_short(grid: bytes, place: slice) -> bytes:
    return _other_place(grid, place, place.start, (place.stop - place.start) // 2)


def _without_length(grid: bytes, place: slice) -> bytes:
    return _other_place(grid, place, place.start, 0)


def _beyond_the_end(grid: bytes, place: slice) -> bytes:
    return _other_place(grid, place, len(grid) - 9, place.stop - place.start)


def _displaced(grid: bytes, place: slice) -> bytes:
    return _other_place(grid, place, place.start + 1, place.stop - place.start)


@pytest.mark.parametrize(
    "damage", [_holed, _empty, _cut_short, _without_length, _beyond_the_end, _displaced]
)
def test_a_tile_that_is_not_there_is_refused(damage: object, grid: bytes, place: slice) -> None:
    assert callable(damage)
    assert is_complete(grid)
    data = damage(grid, place)
    assert not is_complete(data)
    with pytest.raises(InputError, match="damaged or incomplete HEIF file: send it again"):
        decode(data)


def test_a_file_that_ends_too_early_is_not_complete(grid: bytes) -> None:
    assert not is_complete(grid[:-1])
    assert not is_complete(grid[: len(grid) // 2])


def test_a_tile_of_no_picture_is_not_asked_for(grid: bytes, place: slice) -> None:
    """A thumbnail, say: the grid begins with the seventh tile in place of the sixth."""
    parts = struct.pack(">13H", 12, *range(1, 13))
    assert grid.count(parts) == 1
    without = grid.replace(parts, struct.pack(">13H", 12, *range(1, 6), 7, *range(7, 13)))
    assert is_complete(_holed(without, place))


@pytest.mark.parametrize("name", [b"meta", b"pitm", b"iinf", b"iloc"])
def test_boxes_that_are_not_there_are_left_to_libheif(name: bytes, grid: bytes) -> None:
    start = grid.index(name)
    data = grid[:start] + b"none" + grid[start + 4 :]
    assert is_complete(data)
    with pytest.raises(InputError, match="HEIF"):
        decode(data)


def test_a_grid_that_names_no_tiles_is_not_complete(grid: bytes) -> None:
    assert not is_complete(grid.replace(b"iref", b"none", 1))


def test_a_tile_without_a_kind_or_a_place_is_not_there(grid: bytes) -> None:
    kind = struct.pack(">HH", 6, 0) + b"hvc1"
    assert grid.count(kind) == 1
    assert not is_complete(grid.replace(kind, struct.pack(">HH", 99, 0) + b"hvc1"))
    place = struct.pack(">HHHH", 6, 0, 0, 1)
    assert grid.count(place) == 1
    assert not is_complete(grid.replace(place, struct.pack(">HHHH", 99, 0, 0, 1)))


def test_few_zeros_that_coders_append_are_no_hole(grid: bytes, place: slice) -> None:
    """A longer unit, whose tile lies at the end of the file."""
    unit = grid[place]
    length = int.from_bytes(unit[:4], "big")
    assert len(unit) == 4 + length
    padded = struct.pack(">I", length + 3) + unit[4:] + bytes(3)
    told = struct.pack(">II", place.start, len(unit))
    moved = grid.replace(told, struct.pack(">II", len(grid), len(padded)))
    start = moved.index(b"mdat") - 4
    size = struct.pack(">I", len(moved) - start + len(padded))
    data = moved[:start] + size + moved[start + 4 :] + padded
    assert is_complete(data)
    np.testing.assert_array_equal(decode(data).pixels[:], decode(grid).pixels[:])

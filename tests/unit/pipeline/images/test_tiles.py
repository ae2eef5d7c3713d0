from __future__ import annotations

import numpy as np
import pytest

from pipeline.images.coded_image import TableImage
from pipeline.images.tiles import tiles

TABLE = np.linspace(0, 127.5, 256, dtype=np.float32)


def numbered(height: int, width: int) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    """A picture that tells by red and green which tile a pixel is of."""
    y, x = np.mgrid[:height, :width]
    return np.stack([y // 64, x // 128, np.zeros_like(x)], axis=-1).astype(np.uint8)


def test_all_tiles_where_all_are_asked_for() -> None:
    found = tiles(numbered(140, 300), 10**6)

    assert found.shape == (4 * 64, 128, 3)
    assert found.dtype == np.uint8
    assert [tuple(found[64 * k, 0, :2]) for k in range(4)] == [(0, 0), (0, 1), (1, 0), (1, 1)]
    assert all((found[64 * k : 64 * k + 64] == found[64 * k, 0]).all() for k in range(4))


def test_some_tiles_are_spread_from_first_to_last() -> None:
    found = tiles(numbered(640, 640), 3 * 64 * 128)

    assert [tuple(found[64 * k, 0, :2]) for k in range(3)] == [(0, 0), (4, 4), (9, 4)]


def test_tiles_of_code_values_are_light() -> None:
    found = tiles(TableImage(numbered(128, 128), TABLE), 10**6)

    assert found.dtype == np.float32
    np.testing.assert_array_equal(found[64:, :, 0], 0.5)


@pytest.mark.parametrize("width", [40, 127])
def test_a_narrow_picture_has_tiles_of_its_width(width: int) -> None:
    assert tiles(numbered(64, width), 10**6).shape == (64, width, 3)


@pytest.mark.parametrize("coded", [False, True])
def test_a_low_picture_has_none(coded: bool) -> None:
    picture = numbered(63, 500)

    found = tiles(TableImage(picture, TABLE) if coded else picture, 10**6)

    assert found.shape == (0, 128, 3)
    assert found.dtype == (np.float32 if coded else np.uint8)

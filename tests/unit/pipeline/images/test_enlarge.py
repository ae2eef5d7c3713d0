from __future__ import annotations

import numpy as np
import pytest

from pipeline.arrays import Floats32
from pipeline.images.enlarge import enlarge
from tests.definitions.highlights import enlarged

BLOCKS = np.array([[0, 3, 6], [12, 3, -6]], np.float32)[..., None]


def full(blocks: Floats32, side: int, size: tuple[int, int], rows: slice | None = None) -> Floats32:
    """Planes of a picture of that size, or some of its rows."""
    rows = rows or slice(0, size[0])
    planes = np.full((blocks.shape[2], rows.stop - rows.start, size[1]), np.nan, np.float32)
    enlarge(blocks, side, rows, planes)
    return planes


def test_the_middle_of_a_block_is_as_the_block() -> None:
    found = full(BLOCKS, 3, (6, 9))

    np.testing.assert_array_equal(found[0, 1::3, 1::3], BLOCKS[..., 0])


def test_between_middles_it_goes_straight_from_one_block_to_the_other() -> None:
    (found,) = full(BLOCKS, 3, (6, 9))

    np.testing.assert_allclose(found[1], [0, 0, 1, 2, 3, 4, 5, 6, 6], rtol=1e-6)
    np.testing.assert_allclose(found[:, 1], [0, 0, 4, 8, 12, 12], rtol=1e-6)
    np.testing.assert_allclose(found[2, 5], (2 * 4 + 1 * 0) / 3, rtol=1e-6)
    np.testing.assert_allclose(found[3, 5], (1 * 4 + 2 * 0) / 3, atol=1e-6)


def test_blocks_of_an_even_side_have_their_middle_between_pixels() -> None:
    (found,) = full(BLOCKS, 2, (4, 6))

    np.testing.assert_array_equal(found[0], [0, 0.75, 2.25, 3.75, 5.25, 6])
    np.testing.assert_array_equal(found[:, 0], [0, 3, 9, 12])


def test_beyond_the_last_middles_it_stays_as_it_is_there() -> None:
    """Pixels that belong to no block, too, at the right and at the bottom."""
    (found,) = full(BLOCKS, 3, (8, 11))

    np.testing.assert_array_equal(found[0], found[1])
    np.testing.assert_array_equal(found[4:], np.tile(found[4], (4, 1)))
    np.testing.assert_array_equal(found[:, 7:], np.tile(found[:, 7:8], (1, 4)))
    np.testing.assert_array_equal(found[7, [0, 10]], [12, -6])


@pytest.mark.parametrize("shape", [(1, 1), (1, 3), (3, 1)])
def test_along_a_single_block_nothing_changes(shape: tuple[int, int]) -> None:
    blocks = np.arange(1, 1 + shape[0] * shape[1], dtype=np.float32).reshape(*shape, 1)

    (found,) = full(blocks, 4, (4 * shape[0] + 1, 4 * shape[1] + 1))

    for axis in (0, 1):
        if shape[axis] == 1:
            assert not np.diff(found, axis=axis).any()
    assert (found[0, 0], found[-1, -1]) == (1, blocks.size)


def test_blocks_of_one_pixel_are_the_pixels() -> None:
    blocks = np.random.default_rng(1).normal(size=(5, 7, 4)).astype(np.float32)

    np.testing.assert_array_equal(full(blocks, 1, (5, 7)), np.moveaxis(blocks, 2, 0))


def test_a_picture_of_one_block_of_one_pixel() -> None:
    np.testing.assert_array_equal(full(BLOCKS[:1, 1:2], 1, (1, 1)), [[[3]]])


@pytest.mark.parametrize(
    ("side", "size"), [(1, (9, 8)), (2, (19, 16)), (3, (29, 26)), (7, (65, 60))]
)
def test_planes_are_what_they_are_defined_to_be_whatever_rows_are_asked_for(
    side: int, size: tuple[int, int]
) -> None:
    blocks = np.random.default_rng(2).normal(size=(9, 8, 5)).astype(np.float32)

    whole = full(blocks, side, size)

    np.testing.assert_allclose(whole, enlarged(blocks, side, size), atol=2e-6)
    for rows in (1, 4, size[0] - 1):
        cut = [
            full(blocks, side, size, slice(top, min(top + rows, size[0])))
            for top in range(0, size[0], rows)
        ]
        np.testing.assert_array_equal(np.concatenate(cut, axis=1), whole)

from __future__ import annotations

import numpy as np
import pytest

from pipeline.images.blocks import Blocks, any_in_blocks, blocks_within, sums_of_blocks


@pytest.mark.parametrize(
    ("width", "height", "longest", "blocks", "crop"),
    [
        (512, 340, 512, Blocks(1, (512, 340)), (512, 340)),
        (513, 340, 512, Blocks(2, (256, 170)), (512, 340)),
        (340, 1025, 512, Blocks(3, (113, 341)), (339, 1023)),
        (30, 20, 512, Blocks(1, (30, 20)), (30, 20)),
        (1537, 1, 512, Blocks(4, (384, 1)), (1536, 4)),
    ],
)
def test_blocks_are_the_smallest_of_which_the_longer_side_has_so_many(
    width: int, height: int, longest: int, blocks: Blocks, crop: tuple[int, int]
) -> None:
    assert blocks_within(width, height, longest) == blocks
    assert blocks.crop == crop


@pytest.mark.parametrize("block", [1, 3, 7])
@pytest.mark.parametrize("size", [(21, 42), (25, 40), (2, 9)])
@pytest.mark.parametrize("share", [0.0, 0.02, 1.0])
def test_blocks_with_a_marked_pixel(size: tuple[int, int], block: int, share: float) -> None:
    mask = np.random.default_rng(1).random(size) < share
    height, width = size[0] // block, size[1] // block
    whole = mask[: height * block, : width * block]

    found = any_in_blocks(mask, block)

    expected = whole.reshape(height, block, width, block).any(axis=(1, 3))
    np.testing.assert_array_equal(found, expected)


def test_sums_are_of_whole_blocks() -> None:
    image = np.arange(5 * 7 * 2, dtype=np.float64).reshape(5, 7, 2)

    found = sums_of_blocks(image, 2)

    assert found.shape == (2, 3, 2)
    np.testing.assert_array_equal(found[1, 2], image[2:4, 4:6].sum(axis=(0, 1)))

from __future__ import annotations

import numpy as np
import pytest

from pipeline.blocks import any_in_blocks


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

"""Sunlight in patches, as through leaves or blinds: brighter than all around, and no highlight."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from pipeline.lamps.lamps import Lamps
from pipeline.pair.pair import Pair
from pipeline.pair.reduced import reduce_pair
from pipeline.separation.find_highlights import find_highlights

SIZE = (120, 160)
WHITE = np.array([0.37, 1.0, 0.83])
TUNGSTEN = [[1.57, -0.07, -0.03], [0.19, 0.98, -0.3], [0.01, 0.07, 0.33]]
DAYLIGHT = [[0.79, 0.0, -0.01], [0.01, 0.8, -0.04], [0.0, 0.02, 0.68]]


@pytest.mark.parametrize("sun", [0.6, 1.2])
def test_patches_of_sunlight_are_no_highlights(
    pair_of: Callable[..., Pair], lamps_of: Callable[..., Lamps], sun: float
) -> None:
    """On yellow paint they could be highlights of the tungsten lamp, on the red beside it not."""
    matrices = np.array([TUNGSTEN, DAYLIGHT])
    v, u = np.mgrid[: SIZE[0], : SIZE[1]]
    flash = np.where((u < SIZE[1] / 2)[..., None], [0.25, 0.1, 0.07], [0.3, 0.388, 0.15])
    patches = np.hypot(v % 40 - 20, u % 40 - 20) < 2.6
    z = np.stack([0.35 + 0.1 * u / SIZE[1], 0.004 + sun * patches])
    light = np.einsum("nhw,nkl,hwl->hwk", z, matrices, flash)
    lamps = lamps_of(np.eye(3)[:2], matrices=matrices, channel_weights=1 / light.mean(axis=(0, 1)))

    assert find_highlights(reduce_pair(pair_of(light, flash)), lamps, WHITE) is None

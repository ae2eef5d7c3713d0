from __future__ import annotations

import numpy as np
import pytest

from pipeline.images.area_means import area_means
from pipeline.images.area_strips import AreaStrips
from pipeline.images.strips import strips


@pytest.mark.parametrize("smaller", [(30, 20), (29, 17), (60, 39), (7, 1), (59, 40), (60, 40)])
@pytest.mark.parametrize("rows", [1, 3, 7, 40])
def test_means_are_those_of_the_whole_picture(smaller: tuple[int, int], rows: int) -> None:
    picture = np.random.default_rng(1).uniform(size=(40, 60, 3)).astype(np.float32)
    reduced = AreaStrips((60, 40), smaller)

    found = np.concatenate([reduced.add(picture[part]) for part in strips(40, rows)])

    assert found.dtype == np.float32
    np.testing.assert_allclose(found, area_means(picture, smaller), atol=1e-6)


def test_rows_come_as_soon_as_they_are_complete() -> None:
    """5 rows become 2: the third belongs to both."""
    reduced = AreaStrips((4, 5), (2, 2))
    row = np.ones((1, 4, 3), np.float32)

    assert [len(reduced.add(row)) for _ in range(5)] == [0, 0, 1, 0, 1]

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from pipeline.images.by_matrix import by_matrix, fused_by_matrix
from pipeline.images.frames import Colour, numbers_of


@pytest.mark.parametrize("times", [by_matrix, fused_by_matrix])
def test_a_colour_goes_through_a_matrix_row_by_row(times: Callable[..., Colour]) -> None:
    matrix = np.arange(1.0, 10.0).reshape(3, 3)
    r, g, b = np.array([0.5, -0.25, 2.0], np.float32)
    found = times(numbers_of(matrix), r, g, b)
    assert found == tuple(matrix @ (r, g, b)) == (6.0, 12.75, 19.5)
    red, _, _ = times((0.1,) * 9, np.float32(1.0), np.float32(0.0), np.float32(0.0))
    assert red == float(np.float32(0.1))

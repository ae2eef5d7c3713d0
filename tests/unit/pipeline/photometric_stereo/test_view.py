from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipeline.photometric_stereo.view import make_view
from tests.reduced_pairs import even, reduced_pair


@pytest.mark.parametrize(("most", "step"), [(10**6, 1), (500, 3)])
def test_the_cameras_axis_goes_through_the_middle_of_the_photograph(most: int, step: int) -> None:
    """And not of its whole blocks, of which some are left over at the right and below."""
    reduced = replace(reduced_pair(even(0.3, 0.3, 0.3), even(0.2, 0.2, 0.2)), block=12)
    height, width = reduced.usable.shape
    wider = replace(reduced, dropped=(11, 7))

    view = make_view(wider, 1000.0, most)

    assert view.step == step
    side = 12 * step
    middle = np.array([12 * width + 11, 12 * height + 7]) / 2
    np.testing.assert_allclose(view.centre, middle / side - 0.5)
    assert view.focal == pytest.approx(1000 / side)

from __future__ import annotations

import numpy as np
import pytest

from tests.bench import align


def test_the_error_is_the_mean_distance_at_the_corners() -> None:
    moved = np.array([[1.0, 0, 3], [0, 1, 4], [0, 0, 1]])
    wider = np.diag([1.1, 1.0, 1.0])

    assert align._corner_error(moved, np.eye(3), 200, 100) == pytest.approx(5)
    # nothing at the left corners, a tenth of the width at the right ones
    assert align._corner_error(wider, np.eye(3), 200, 100) == pytest.approx(10)


def test_pictures_are_moved_by_the_matrix() -> None:
    picture = np.zeros((40, 60, 3), np.uint8)
    picture[10, 20] = 255

    moved = align._warped(picture, np.array([[1.0, 0, 7], [0, 1, -4], [0, 0, 1]]))

    assert moved[..., 0].argmax() == 6 * 60 + 27

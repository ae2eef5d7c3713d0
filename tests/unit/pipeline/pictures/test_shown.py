from __future__ import annotations

import numpy as np
import pytest

from pipeline.pictures.shown import shown_gain

EYE = np.eye(3)


@pytest.mark.parametrize(
    ("light", "gain"), [(0.5, 2.0), (2.0, 0.5), (1e-3, 8.0), (0.0, 8.0), (100.0, 0.01), (1e6, 1e-6)]
)
def test_bright_parts_become_white_and_dark_ones_no_more_than_eight_times_as_bright(
    light: float, gain: float
) -> None:
    picture = np.full((40, 40, 3), (light, light / 2, light / 4), np.float32)

    assert shown_gain(picture, EYE) == pytest.approx(gain)


@pytest.mark.parametrize("times", [1, 20])
def test_a_few_highlights_do_not_darken_the_rest(times: int) -> None:
    """0.4 % of the pixels, also where not all are looked at."""
    picture = np.full((200, 200, 3), 0.5, np.float32)
    picture[:4, :40] = 9.0

    assert shown_gain(picture.repeat(times, 0).repeat(times, 1), EYE) == pytest.approx(2.0)


def test_the_gain_is_that_of_the_screens_brightest_channel() -> None:
    matrix = np.array([[1.0, 0, 0], [0, 4.0, 0], [0, 0, 1.0]])

    assert shown_gain(np.full((8, 8, 3), 0.5, np.float32), matrix) == pytest.approx(0.5)

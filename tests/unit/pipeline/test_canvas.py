from __future__ import annotations

import numpy as np
import pytest

from pipeline.canvas import Canvas, shown_gain
from pipeline.frames import Image

EYE = np.eye(3)


@pytest.fixture
def picture() -> Image:
    """Higher than a strip, from below black to beyond white."""
    rng = np.random.default_rng(6)
    return rng.uniform(-0.2, 30, (300, 9, 3)).astype(np.float32)


def canvas_of(picture: Image) -> Canvas:
    canvas = Canvas((picture.shape[1], picture.shape[0]))
    for top in range(0, len(picture), 70):
        canvas.write(picture[top : top + 70])
    return canvas


def test_a_picture_comes_back_to_a_twentieth_of_a_step(picture: Image) -> None:
    canvas = canvas_of(picture)

    found = canvas.picture()

    assert found.dtype == np.float32
    np.testing.assert_allclose(found, picture, rtol=2**-11, atol=1e-7)
    np.testing.assert_array_equal(np.concatenate(list(canvas.strips())), found)


def test_light_beyond_half_floats_stays_finite() -> None:
    picture = np.full((4, 4, 3), 1e9, np.float32)

    assert (canvas_of(picture).picture() == 65504).all()


@pytest.mark.parametrize(
    ("light", "gain"), [(0.5, 2.0), (2.0, 0.5), (1e-3, 8.0), (0.0, 8.0), (100.0, 0.25), (1e9, 0.25)]
)
def test_bright_parts_become_white_within_limits(light: float, gain: float) -> None:
    picture = np.full((40, 40, 3), (light, light / 2, light / 4), np.float32)

    assert shown_gain(picture, EYE) == pytest.approx(gain)
    assert canvas_of(picture).gain(EYE) == pytest.approx(gain)


def test_a_few_highlights_do_not_darken_the_rest() -> None:
    """0.4 % of the pixels that are looked at."""
    picture = np.full((200, 200, 3), 0.5, np.float32)
    picture[:4, :40] = 9.0

    assert shown_gain(picture, EYE) == pytest.approx(2.0)


def test_the_gain_is_that_of_the_screens_brightest_channel() -> None:
    matrix = np.array([[1.0, 0, 0], [0, 4.0, 0], [0, 0, 1.0]])

    assert shown_gain(np.full((8, 8, 3), 0.5, np.float32), matrix) == pytest.approx(0.5)

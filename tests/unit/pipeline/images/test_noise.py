from __future__ import annotations

import numpy as np
import pytest

from pipeline.images.noise import Noise, line_through

GAIN, FLOOR = 2e-4, 2e-6
NOISE = Noise(np.full(3, GAIN), np.full(3, FLOOR))


def test_variance_is_a_line_over_brightness_and_flat_below_black() -> None:
    found = NOISE.variance(np.array([[0.0, 0.5, 1.0], [-0.3, -1.0, 2.0]]))

    expected = GAIN * np.array([[0.0, 0.5, 1.0], [0.0, 0.0, 2.0]]) + FLOOR
    np.testing.assert_allclose(found, expected)


@pytest.mark.parametrize(
    ("grain", "averaged", "factor"), [(1, 1, 1), (1, 16, 1 / 16), (4, 16, 1 / 4), (4, 2, 1)]
)
def test_means_of_pixels_have_less_noise_beyond_the_grain(
    grain: float, averaged: float, factor: float
) -> None:
    noise = Noise(np.full(3, GAIN), np.full(3, FLOOR), grain)
    pixels = np.full(3, 0.4)

    found = noise.variance(pixels, averaged)

    np.testing.assert_allclose(found, factor * noise.variance(pixels))


def test_noise_of_means() -> None:
    white, grainy = Noise(NOISE.gain, NOISE.floor), Noise(NOISE.gain, NOISE.floor, grain=8.0)

    np.testing.assert_allclose(white.of_means(4).floor, NOISE.floor / 16)
    np.testing.assert_allclose(grainy.of_means(4).gain, NOISE.gain / 2)
    np.testing.assert_allclose(grainy.of_means(2).gain, NOISE.gain)
    assert grainy.of_means(2).grain == 2


def test_noise_of_blurred_values_is_less_but_not_that_of_wide_means() -> None:
    level = np.full(3, 0.3)

    found = Noise(NOISE.gain, NOISE.floor, grain=2.0)
    after = found.blurred(0.2)

    np.testing.assert_allclose(after.variance(level), 0.2 * found.variance(level))
    np.testing.assert_allclose(after.variance(level, 64), found.variance(level, 64))


def test_noise_of_divided_values() -> None:
    """A quarter of the values has a sixteenth of the variance."""
    pixels = np.array([0.1, 0.4, 0.8])

    found = Noise(NOISE.gain, NOISE.floor, grain=3.0).divided(4.0)

    np.testing.assert_allclose(found.variance(pixels / 4), NOISE.variance(pixels) / 16)
    assert found.grain == 3


def test_two_noises_add_up() -> None:
    """The grain is that of the stronger one, as far as it is the stronger."""
    loud = Noise(3 * NOISE.gain, 3 * NOISE.floor, grain=5.0)
    pixels = np.array([0.1, 0.4, 0.8])

    found = NOISE.plus(loud)

    np.testing.assert_allclose(found.variance(pixels), 4 * NOISE.variance(pixels))
    assert found.grain == pytest.approx(4)


@pytest.mark.parametrize(
    ("variances", "gain", "floor"),
    [
        ([3.0, 5.0, 7.0], 2.0, 1.0),
        ([4.0, 4.0, 4.0], 1e-10, 4.0),  # no gain: a trace is left, so that nothing is exact
        ([0.0, 0.0, 0.0], 1e-10, 1e-13),
    ],
)
def test_line_through_variances(variances: list[float], gain: float, floor: float) -> None:
    found = line_through(np.array([1.0, 2.0, 3.0]), np.array(variances))

    assert found == pytest.approx((gain, floor), rel=1e-6, abs=0)


def test_a_line_is_nowhere_negative() -> None:
    """Variance that falls with brightness, and variance that is gone before black."""
    falling = line_through(np.array([1.0, 2.0, 3.0]), np.array([9.0, 5.0, 3.0]))
    steep = line_through(np.array([1.0, 2.0, 3.0]), np.array([0.5, 3.0, 6.0]))

    assert falling[0] == pytest.approx(1e-10, abs=0)
    assert 3 < falling[1] < 9
    assert steep[1] == pytest.approx(1e-13, abs=0)
    assert 0.5 < steep[0] < 2

from __future__ import annotations

import cv2
import numpy as np
import pytest

from pipeline.arrays import Floats32
from pipeline.decode.compression_noise import compression_noise

Image = Floats32
ALL = (1.0, 1.0, 1.0)
"""Of what the first compression changed, the second one changes as much."""


def wedge() -> Image:
    levels = np.linspace(0.02, 0.8, 256, dtype=np.float32)
    return np.broadcast_to(levels[None, :, None], (256, 256, 3)).copy()


def drawn(sigma: float) -> Image:
    """Random numbers of unit variance, which hang together over a blur of sigma pixels."""
    white = np.random.default_rng(1).normal(size=(256, 256, 3)).astype(np.float32)
    found = cv2.GaussianBlur(white, (0, 0), sigma) if sigma > 0 else white
    return np.asarray(found / found.std(), dtype=np.float32)


def test_noise_is_half_as_much_again_as_the_change() -> None:
    """In variance, of each channel, over brightness: within a tenth."""
    gain, floor = np.array([1e-4, 2e-4, 4e-4]), np.array([4e-6, 2e-6, 1e-6])
    light = wedge()

    found = compression_noise(light, light + drawn(0) * np.sqrt(gain * light + floor), ALL)

    for level in (0.1, 0.4, 0.7):
        ratio = found.variance(np.full(3, level)) / (gain * level + floor)
        np.testing.assert_allclose(ratio, 1.5, rtol=0.1)
    assert found.grain == pytest.approx(1, abs=0.1)


def test_a_change_that_hangs_together_has_grain() -> None:
    """A blur by one pixel hangs together over 4π; means over 8 × 8 pixels see most of it."""
    light = wedge()

    found = compression_noise(light, light + np.float32(0.01) * drawn(1.0), ALL)

    assert 0.7 * 4 * np.pi < found.grain < 4 * np.pi


def test_what_is_not_repeated_counts_as_well() -> None:
    light = wedge()
    again = light + np.float32(0.01) * drawn(0)

    found = compression_noise(light, again, (0.5, 0.8, 1.0))
    told = compression_noise(light, again, ALL)

    colour = np.full(3, 0.4)
    np.testing.assert_allclose(found.variance(colour) / told.variance(colour), [2.0, 1.25, 1.0])
    assert found.grain == told.grain


def test_nothing_changed_is_no_noise() -> None:
    light = wedge()

    found = compression_noise(light, light, ALL)

    assert (found.variance(np.full(3, 0.5)) < 1e-9).all()
    assert found.grain == 1


@pytest.mark.parametrize("share", [0.05, 0.2, 0.5])
def test_what_is_white_has_no_part_in_it(share: float) -> None:
    light, change = wedge(), np.float32(0.01) * drawn(0)
    whole = compression_noise(light, light + change, ALL)
    white = np.s_[: round(share * 256)]
    light[white], change[white] = 1.0, 0.0

    found = compression_noise(light, light + change, ALL)

    for level in (0.1, 0.4, 0.7):
        colour = np.full(3, level)
        np.testing.assert_allclose(found.variance(colour) / whole.variance(colour), 1, rtol=0.1)


def test_a_picture_that_is_white_all_over_has_none() -> None:
    white = np.ones((256, 256, 3), np.float32)

    found = compression_noise(white, white, ALL)

    assert (found.variance(np.full(3, 0.5)) < 1e-9).all()

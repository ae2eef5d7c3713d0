from __future__ import annotations

import numpy as np
import pytest

from pipeline.pair.misregistration import HALO, SOFTENED_HALO, registration_variance, softened


def test_an_even_picture_does_not_mind() -> None:
    assert not registration_variance(np.full((9, 9, 3), 0.4, np.float32), 0.5).any()


@pytest.mark.parametrize("deviation", [0.1, 0.35])
def test_a_slope_shifted_by_a_little_changes_by_as_much_times_the_slope(deviation: float) -> None:
    ramp = np.broadcast_to(0.01 * np.arange(20)[None, :, None], (20, 20, 3)).astype(np.float32)

    found = registration_variance(ramp, deviation)

    np.testing.assert_allclose(found[:, 1:-1], (deviation * 0.01) ** 2, rtol=1e-4)


def test_a_thin_line_counts_on_its_ridge() -> None:
    line = np.zeros((9, 9, 3), np.float32)
    line[:, 4] = 0.8

    found = registration_variance(line, 0.5)

    np.testing.assert_allclose(found[:, 3:6], 0.04, rtol=1e-5)
    assert not found[:, [0, 1, 2, 6, 7, 8]].any()


def test_strips_with_their_halo_are_as_the_whole() -> None:
    image = np.random.default_rng(1).uniform(0, 1, (30, 12, 3)).astype(np.float32)

    whole = registration_variance(image, 0.3)
    part = registration_variance(image[10 - HALO : 20 + HALO], 0.3)[HALO:-HALO]

    np.testing.assert_array_equal(part, whole[10:20])


def test_softened_strips_with_their_halo_are_as_the_whole() -> None:
    image = np.random.default_rng(1).uniform(0, 1, (30, 12, 3)).astype(np.float32)

    part = softened(image[10 - SOFTENED_HALO : 20 + SOFTENED_HALO])[SOFTENED_HALO:-SOFTENED_HALO]

    np.testing.assert_allclose(part, softened(image)[10:20], atol=1e-6)


def test_photographs_half_a_pixel_apart_differ_less_once_softened() -> None:
    step = np.zeros((12, 24, 3), np.float32)
    step[:, 12:] = 1.0
    beside = step.copy()
    beside[:, 11] = 0.5

    sharp, soft = np.abs(step - beside).max(), np.abs(softened(step) - softened(beside)).max()

    assert soft < 0.75 * sharp
    assert softened(step).mean() == pytest.approx(step.mean(), abs=1e-3)

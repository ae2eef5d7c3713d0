from __future__ import annotations

import numpy as np
import pytest

from pipeline.matrixfit.evidence import (
    evidence_of_area,
    evidence_of_surfaces,
    gather_evidence,
)
from pipeline.pair.reduced import ReducedPair
from tests.reduced_pairs import HEIGHT, WIDTH, even, left_and_right, reduced_pair

CENTRED = np.eye(3) - 1 / 3


def test_pixels_are_chromaticities_of_light_and_flash() -> None:
    found = gather_evidence(
        reduced_pair(even(0.4, 0.3, 0.1), even(0.2, 0.5, 0.3), flash_only=True)
    ).pixels

    assert len(found) == HEIGHT * WIDTH
    np.testing.assert_allclose(found.x, np.tile([0.2, 0.5, 0.3], (len(found), 1)))
    np.testing.assert_allclose(found.u, np.tile([0.5, 0.375], (len(found), 1)))
    assert found.weight.sum() == pytest.approx(400)


@pytest.mark.parametrize("flash_only", [True, False])
def test_noise_of_grey_pixels_is_known(flash_only: bool) -> None:
    """Light a and flash part b, both grey: variances v over (3a)² and (3b)², off the diagonal."""
    a, b, v_n, v_f = 0.4, 0.5, 1e-5, 3e-5
    variances = {"no_flash_variance": v_n, "flash_variance": v_f}
    pair = reduced_pair(even(a, a, a), even(b, b, b), flash_only, **variances)

    found = gather_evidence(pair).pixels

    size = v_n / a**2 + v_f / b**2 + (0 if flash_only else 2 * v_n / (a * b))
    expected = CENTRED[[0, 0, 1], [0, 1, 1]] * size / 9
    np.testing.assert_allclose(found.covariance, np.tile(expected, (len(found), 1)), rtol=1e-9)


@pytest.mark.parametrize("flash_only", [True, False])
def test_noise_of_coloured_pixels_is_what_it_does_to_them(flash_only: bool) -> None:
    rng = np.random.default_rng(2)
    n, f = np.array([0.5, 0.3, 0.2]), np.array([0.3, 0.4, 0.35])
    v_n, v_f = np.array([1e-6, 2e-6, 3e-6]), np.array([5e-6, 6e-6, 4e-6])
    variances = {"no_flash_variance": v_n, "flash_variance": v_f}
    pair = reduced_pair(even(*n), even(*f), flash_only, **variances)
    noise_n = rng.normal(0, np.sqrt(v_n), (200_000, 3))
    if flash_only:
        noise_f = rng.normal(0, np.sqrt(v_f), noise_n.shape)
    else:  # the photograph with the flash less the one without
        noise_f = rng.normal(0, np.sqrt(v_f - v_n), noise_n.shape) - noise_n
    x, u = f / f.sum(), n / n.sum()
    noisy_x, noisy_u = (
        (one + noise) / (one + noise).sum(axis=1, keepdims=True)
        for one, noise in ((f, noise_f), (n, noise_n))
    )
    # the lamp that gives u on x gives this on the noisy flash colour
    predicted = u / x * noisy_x
    residual = noisy_u - predicted / predicted.sum(axis=1, keepdims=True)
    true = np.cov(residual[:, :2].T)

    found = gather_evidence(pair).pixels.covariance[0]

    np.testing.assert_allclose(found, true[[0, 0, 1], [0, 1, 1]], atol=0.02 * true.max())


def test_no_photograph_is_better_than_its_least_noise() -> None:
    found = gather_evidence(
        reduced_pair(even(0.4, 0.4, 0.4), even(0.5, 0.5, 0.5), flash_only=True)
    ).pixels

    np.testing.assert_allclose(found.covariance[:, 0], 2 / 3 * 2 * 1.5e-4**2)


def test_pixels_that_are_not_usable_or_dark_are_left_out() -> None:
    light, flash = even(0.4, 0.3, 0.1), even(0.2, 0.5, 0.3)
    usable = np.ones((HEIGHT, WIDTH), bool)
    usable[:10] = False
    light[10:15] *= 0.004
    flash[15:20] *= 0.009

    found = gather_evidence(reduced_pair(light, flash, usable=usable, flash_only=True)).pixels

    assert len(found) == 20 * WIDTH


def test_nothing_usable_is_no_evidence() -> None:
    pair = reduced_pair(
        even(0.4, 0.3, 0.1), even(0.2, 0.5, 0.3), usable=np.zeros((HEIGHT, WIDTH), bool)
    )

    found = gather_evidence(pair)

    assert len(found.pixels) == len(found.differences) == len(found.terminators) == 0
    assert found.difference_share == 0


def two_brightnesses(share: float = 0.5) -> ReducedPair:
    """Of 10,000 pixels, those on the left have four times the light; flash colours differ."""
    left = np.arange(100)[None, :, None] < 100 * share
    flash = np.where(left, [0.4, 0.3, 0.3], [0.3, 0.4, 0.3]) * np.ones((100, 100, 1))
    return reduced_pair(np.where(left, 0.8, 0.2) * flash, flash, flash_only=True)


def test_pixels_are_drawn_by_the_root_of_their_light() -> None:
    found = gather_evidence(two_brightnesses()).pixels

    assert len(found) == 3600
    assert (found.x[:, 0] > found.x[:, 1]).sum() == pytest.approx(2400, abs=2)
    np.testing.assert_allclose(found.weight, 400 / 3600)


def test_drawing_is_the_same_every_time() -> None:
    first, second = (gather_evidence(two_brightnesses(0.3)).pixels for _ in range(2))

    np.testing.assert_array_equal(first.x, second.x)
    np.testing.assert_array_equal(first.u, second.u)


def test_rare_light_is_drawn_more_often() -> None:
    flash = np.full((100, 100, 3), 0.3)
    light = flash.copy()
    light[:4] = (0.6, 0.2, 0.1)  # of the same sum: 400 of 10,000 pixels

    found = gather_evidence(reduced_pair(light, flash, flash_only=True)).pixels

    rare, common = 400**-0.6 * 400, 9600**-0.6 * 9600
    drawn = (found.u[:, 0] > 0.5).sum()
    assert drawn == pytest.approx(min(3600 * rare / (rare + common), 400), abs=2)
    assert drawn > 2 * 3600 * 400 / 10_000


def test_noisy_pixels_are_left_out() -> None:
    light, flash = even(0.4, 0.4, 0.4), left_and_right(even(0.5, 0.5, 0.5), even(0.6, 0.5, 0.4))
    noise = left_and_right(even(*(0.03,) * 3), even(*(0.05,) * 3))  # relative to the whole light
    variance = (noise * 1.2) ** 2 / 3

    found = gather_evidence(
        reduced_pair(light, flash, no_flash_variance=variance, flash_only=True)
    ).pixels

    assert len(found) == HEIGHT * WIDTH / 2
    np.testing.assert_allclose(found.x, 1 / 3)


def test_of_a_very_noisy_pair_the_least_noisy_pixels_are_taken() -> None:
    light, flash = even(0.4, 0.4, 0.4), left_and_right(even(0.5, 0.5, 0.5), even(0.6, 0.5, 0.4))
    noise = left_and_right(even(*(0.2,) * 3), even(*(0.3,) * 3))
    variance = (noise * 1.2) ** 2 / 3

    found = gather_evidence(
        reduced_pair(light, flash, no_flash_variance=variance, flash_only=True)
    ).pixels

    assert len(found) == HEIGHT * WIDTH / 2
    np.testing.assert_allclose(found.x, 1 / 3)


def test_an_area_shows_its_usable_pixels_and_counts_less_than_a_picture() -> None:
    """60 instead of 400, as the noise of its pixels is that of the picture's."""
    light = left_and_right(even(0.4, 0.3, 0.1), even(0.1, 0.2, 0.1))
    usable = np.ones((HEIGHT, WIDTH), bool)
    usable[:10] = False
    light[:10] = 9.0
    pair = reduced_pair(light, even(0.2, 0.5, 0.3), usable=usable, no_flash_variance=1e-5)
    area = np.broadcast_to(np.arange(WIDTH) < 20, (HEIGHT, WIDTH))

    found = evidence_of_area(pair, area)

    assert len(found) == 30 * 20
    np.testing.assert_allclose(found.x, np.tile([0.2, 0.5, 0.3], (600, 1)))
    np.testing.assert_allclose(found.u, np.tile([0.5, 0.375], (600, 1)))
    np.testing.assert_allclose(found.weight, 60 / 600)
    whole = gather_evidence(pair).pixels
    of_area = whole.covariance[whole.u[:, 0] > 0.4][0]
    np.testing.assert_allclose(found.covariance, np.tile(of_area, (600, 1)))


def test_surfaces_are_chromaticities_that_are_sure() -> None:
    flash, light = np.array([[2.0, 2, 4], [1, 0, 0]]), np.array([[1.0, 2, 1], [5, 5, 0]])
    found = evidence_of_surfaces(flash, light)
    np.testing.assert_allclose(found.x, [[0.25, 0.25, 0.5], [1.0, 0, 0]])
    np.testing.assert_allclose(found.u, [[0.25, 0.5], [0.5, 0.5]])
    assert not found.covariance.any()
    assert found.weight.tolist() == [200, 200]


@pytest.mark.parametrize("dark", [0.0, -0.1])
def test_surfaces_that_either_light_leaves_dark_are_left_out(dark: float) -> None:
    flash, light = np.ones((4, 3)), np.full((4, 3), 2.0)
    flash[0], light[2] = dark, dark
    found = evidence_of_surfaces(flash, light)
    np.testing.assert_allclose(found.x, np.full((2, 3), 1 / 3))
    assert found.weight.tolist() == [200, 200]
    assert len(evidence_of_surfaces(flash[:1], light[:1])) == 0

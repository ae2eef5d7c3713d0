from __future__ import annotations

import numpy as np
import pytest

from pipeline.arrays import Floats, Floats32
from pipeline.separation.smoothing import HALO, smooth_proportions
from tests.definitions import pixels

HEIGHT, WIDTH = 60, 80
EVERYWHERE = np.ones((HEIGHT, WIDTH), np.float32)


def of_two(first: Floats) -> Floats32:
    """Proportions (2, h, W, 3) of two lamps, equal in every channel."""
    both = np.stack([first, 1 - first])
    return np.repeat(both[..., None], 3, axis=3).astype(np.float32)


def smoothed(
    proportions: Floats32,
    no_flash: Floats,
    flash: Floats | float = 0.3,
    trust: Floats32 = EVERYWHERE,
    rows: int = HEIGHT,
    uncertainty: float = 1.0,
) -> Floats32:
    """Smooth in strips of so many rows, each with its halo. no_flash, flash: (h, W) brightness."""
    unsure = np.full((HEIGHT, WIDTH), uncertainty, np.float32)
    light, flashed = (
        np.repeat(np.broadcast_to(plane, (HEIGHT, WIDTH))[..., None], 3, axis=2).astype(np.float32)
        for plane in (no_flash, np.asarray(flash))
    )
    strips = []
    for top in range(0, HEIGHT, rows):
        first, last = max(top - HALO, 0), min(top + rows + HALO, HEIGHT)
        keep = slice(top - first, min(top + rows, HEIGHT) - first)
        part = slice(first, last)
        strips.append(
            smooth_proportions(
                proportions[:, part], light[part], flashed[part], trust[part], unsure[part], keep
            )
        )
    return np.concatenate(strips, axis=1)


@pytest.fixture
def noisy() -> Floats32:
    """Proportions of 0.7 and 0.3, with noise."""
    drawn = np.random.default_rng(1).normal(0.7, 0.1, (HEIGHT, WIDTH))
    return of_two(np.clip(drawn, 0, 1))


def test_noise_is_averaged_away_where_the_light_is_even(noisy: Floats32) -> None:
    found = smoothed(noisy, np.full((HEIGHT, WIDTH), 0.4))

    assert found.dtype == np.float32
    assert np.abs(found[0] - 0.7).mean() < 0.2 * np.abs(noisy[0] - 0.7).mean()


def test_what_noise_cannot_have_done_stays(noisy: Floats32) -> None:
    exact = smoothed(noisy, np.full((HEIGHT, WIDTH), 0.4), uncertainty=1e-4)

    np.testing.assert_allclose(exact, noisy, atol=2e-3)


def test_patterns_of_the_surface_do_not_show(noisy: Floats32) -> None:
    """A checkered cloth under even light: lamps and flash see the same pattern, which cancels."""
    cloth = 0.2 + 0.6 * (np.indices((HEIGHT, WIDTH)).sum(axis=0) // 4 % 2)

    even = smoothed(noisy, np.full((HEIGHT, WIDTH), 0.4), 0.3)
    checkered = smoothed(noisy, 0.4 * cloth, 0.3 * cloth)

    np.testing.assert_allclose(checkered, even, atol=1e-3)


def test_the_edge_of_a_shadow_stays_sharp() -> None:
    left = np.arange(WIDTH) < WIDTH // 2
    first = np.broadcast_to(np.where(left, 0.9, 0.2), (HEIGHT, WIDTH))
    light = np.broadcast_to(np.where(left, 0.6, 0.2), (HEIGHT, WIDTH))

    found = smoothed(of_two(first), light)

    np.testing.assert_allclose(found[0, ..., 1], first, atol=0.02)


def test_pixels_that_are_not_trusted_take_from_those_around(noisy: Floats32) -> None:
    trust = EVERYWHERE.copy()
    trust[20:24, 30:34] = 0
    noisy[:, 20:24, 30:34] = np.array([0.0, 1.0])[:, None, None, None]

    found = smoothed(noisy, np.full((HEIGHT, WIDTH), 0.4), trust=trust)

    np.testing.assert_allclose(found[0, 20:24, 30:34], 0.7, atol=0.08)


@pytest.mark.parametrize("trust", [0.0, 1.0])
@pytest.mark.parametrize("seed", [1, 2])
def test_proportions_stay_proportions(trust: float, seed: int) -> None:
    """Any pixels, any light: within 0 and 1, and together 1."""
    rng = np.random.default_rng(seed)
    proportions = rng.dirichlet(np.full(3, 0.2), (HEIGHT, WIDTH, 3)).transpose(3, 0, 1, 2)
    light, flash = rng.normal(0.05, 0.1, (2, HEIGHT, WIDTH))

    found = smoothed(proportions.astype(np.float32), light, flash, trust * EVERYWHERE)

    assert found.min() >= 0
    assert found.max() <= 1 + 1e-6
    np.testing.assert_allclose(found.sum(axis=0), 1, atol=1e-5)


def test_a_brighter_spot_leaves_the_sum_of_three_lamps_whole() -> None:
    """The guide goes beyond what was seen around: one lamp would be more than all the light."""
    left = np.arange(WIDTH) < WIDTH // 2
    parts = (np.where(left, 0.2, 0.8), np.full(WIDTH, 0.1), np.where(left, 0.7, 0.1))
    proportions = np.stack([np.broadcast_to(part, (HEIGHT, WIDTH)) for part in parts])
    light = np.tile(np.where(left, 0.4, 0.45), (HEIGHT, 1))
    light[30, WIDTH // 2 + 4] = 0.52

    found = smoothed(proportions[..., None].repeat(3, 3).astype(np.float32), light, 1 - light)

    assert found[0, 30, WIDTH // 2 + 4, 1] > 0.9
    np.testing.assert_allclose(found.sum(axis=0), 1, atol=1e-5)


def test_even_proportions_stay_as_they_are() -> None:
    light = np.random.default_rng(4).uniform(0, 0.8, (HEIGHT, WIDTH))

    found = smoothed(of_two(np.full((HEIGHT, WIDTH), 0.35)), light)

    np.testing.assert_allclose(found[0], 0.35, atol=1e-4)


def test_without_any_light_nothing_breaks(noisy: Floats32) -> None:
    found = smoothed(noisy, np.zeros((HEIGHT, WIDTH)), 0.0)

    np.testing.assert_allclose(found.sum(axis=0), 1, atol=1e-5)


@pytest.mark.parametrize("rows", [1, 7, 16, 59])
def test_rows_may_be_cut_anywhere(noisy: Floats32, rows: int) -> None:
    light = np.random.default_rng(4).uniform(0, 0.8, (HEIGHT, WIDTH))
    trust = (np.random.default_rng(5).uniform(size=(HEIGHT, WIDTH)) > 0.3).astype(np.float32)

    whole = smoothed(noisy, light, trust=trust)
    cut = smoothed(noisy, light, trust=trust, rows=rows)

    np.testing.assert_array_equal(cut, whole)


def test_what_noise_cannot_have_done_is_left(noisy: Floats32) -> None:
    """A detail that the guide does not show, in proportions that are known well, or hardly."""
    detail = of_two(np.full((HEIGHT, WIDTH), 0.7))
    detail[:, 30:32, 40:42] = np.array([0.1, 0.9])[:, None, None, None]
    light = np.full((HEIGHT, WIDTH), 0.4)

    well, hardly = (smoothed(detail, light, uncertainty=u)[0, 30, 40, 1] for u in (0.01, 1.0))

    assert well == pytest.approx(0.1, abs=0.02)
    assert hardly > 0.55
    np.testing.assert_array_equal(smoothed(noisy, light, uncertainty=0.0), noisy)


def test_one_lamp_has_nothing_to_smooth() -> None:
    alone = np.ones((1, HEIGHT, WIDTH, 3), np.float32)

    np.testing.assert_array_equal(smoothed(alone, np.full((HEIGHT, WIDTH), 0.4), rows=16), alone)


@pytest.mark.parametrize("count", [2, 3])
def test_smoothing_is_what_it_is_defined_to_be(count: int) -> None:
    rng = np.random.default_rng(6)
    size = (HEIGHT, WIDTH)
    drawn = rng.dirichlet(np.full(count, 0.4), (*size, 3)).transpose(3, 0, 1, 2)
    proportions = np.ascontiguousarray(drawn, np.float32)
    light, flash = rng.uniform(-0.05, 0.8, (2, *size, 3)).astype(np.float32)
    trust = rng.uniform(size=size).astype(np.float32) * (rng.uniform(size=size) > 0.2)
    unsure = rng.uniform(size=size).astype(np.float32)
    given = (light, flash, trust.astype(np.float32), unsure, slice(5, 41))

    found = smooth_proportions(proportions, *given)

    defined = pixels.smooth_proportions(proportions, *given)
    np.testing.assert_allclose(found, defined, atol=1e-5)

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.arrays import Floats64
from pipeline.matrixfit.chromaticities import Chromaticities
from pipeline.matrixfit.contrasts import RelativeLight, contrast, drawn, relative_light, steps

STEP, BOTH = np.array([1.0, -1.0]), np.array([0.5, 0.5])


def ratios_of(
    light: Floats64, flash: Floats64, v_n: float = 1e-9, v_f: float = 1e-9, coupled: float = 0.0
) -> RelativeLight:
    use = np.ones(light.shape[:2], np.bool_)
    return relative_light(
        light, flash, np.full_like(light, v_n), np.full_like(flash, v_f), use, coupled
    )


def row(*colours: tuple[float, float, float]) -> Floats64:
    return np.array([colours])


def places(*columns: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    found = np.array([columns])
    return np.zeros_like(found), found


def test_light_is_relative_to_the_strength_of_the_flash() -> None:
    found = ratios_of(row((0.4, 0.2, 0.1)), row((0.1, 0.3, 0.1)), v_f=3e-4)

    np.testing.assert_allclose(found.light, row((0.8, 0.4, 0.2)))
    np.testing.assert_allclose(found.colour, row((0.2, 0.6, 0.2)))
    np.testing.assert_allclose(found.total, [[1.4]])
    np.testing.assert_allclose(found.noise, [[0.03 / 0.5]])


@pytest.mark.parametrize("coupled", [0.0, 1.0])
def test_the_noise_of_light_is_that_of_photograph_and_flash(coupled: float) -> None:
    rng = np.random.default_rng(1)
    n, f = np.array([0.5, 0.3, 0.2]), np.array([0.3, 0.4, 0.35])
    v_n, v_f = 1e-6, 5e-6
    noise_n = rng.normal(0, np.sqrt(v_n), (400_000, 3))
    # a flash part that is a difference has the photograph's noise in it, with the other sign
    noise_f = rng.normal(0, np.sqrt(v_f - coupled * v_n), noise_n.shape) - coupled * noise_n
    true = np.cov(((n + noise_n) / (f + noise_f).sum(axis=1, keepdims=True)).T)

    found = ratios_of(n[None, None], f[None, None], v_n, v_f, coupled).covariance(places(0))

    np.testing.assert_allclose(found[0, 0], true, atol=0.02 * true.max())


def test_a_contrast_is_the_light_that_changes() -> None:
    """Between two places of one colour: (0.3, 0.2, 0.1) more on the left."""
    light, flash = row((0.5, 0.5, 0.4), (0.2, 0.3, 0.3)), row((0.5, 0.5, 0.5), (0.5, 0.5, 0.5))

    found = contrast(ratios_of(light, flash), places(0, 1), STEP, BOTH)

    np.testing.assert_allclose(found.u, [[1 / 2, 1 / 3]])
    np.testing.assert_allclose(found.x, [[1 / 3] * 3])
    # the root of the light that changes
    np.testing.assert_allclose(found.weight, np.sqrt(0.6))


def test_the_surface_is_that_of_the_places_named() -> None:
    light = row((0.5, 0.5, 0.4), (0.2, 0.3, 0.3))
    flash = row((0.5, 0.5, 0.5), (0.45, 0.5, 0.55))

    of_both = contrast(ratios_of(light, flash), places(0, 1), STEP, BOTH)
    of_second = contrast(ratios_of(light, flash), places(0, 1), STEP, np.array([0.0, 1.0]))

    np.testing.assert_allclose(of_both.x, [[19 / 60, 1 / 3, 21 / 60]])
    np.testing.assert_allclose(of_second.x, [[0.3, 1 / 3, 11 / 30]])


@pytest.mark.parametrize(("significance", "some"), [(40.0, True), (41.0, False)])
def test_contrasts_stand_out_from_noise_as_much_as_is_asked(
    significance: float, some: bool
) -> None:
    """A sum of 0.1 under a flash of strength 1; its deviation is √(6 · 1e-6)."""
    light = row((0.5, 0.5, 0.4), (0.48, 0.46, 0.36))
    ratios = ratios_of(light, row((0.4, 0.3, 0.3), (0.4, 0.3, 0.3)), v_n=1e-6, v_f=1e-12)

    found = contrast(ratios, places(0, 1), STEP, BOTH, significance)

    assert bool(len(found)) is some


def test_contrasts_of_unsure_colour_are_left_out() -> None:
    light = row((0.5, 0.5, 0.4), (0.48, 0.46, 0.36))
    ratios = ratios_of(light, row((0.4, 0.3, 0.3), (0.4, 0.3, 0.3)), v_n=1e-4, v_f=1e-12)

    assert not len(contrast(ratios, places(0, 1), STEP, BOTH))


def test_contrasts_the_other_way_round_are_left_out() -> None:
    light, flash = row((0.2, 0.3, 0.3), (0.5, 0.5, 0.4)), row((0.5, 0.5, 0.5), (0.5, 0.5, 0.5))

    assert not len(contrast(ratios_of(light, flash), places(0, 1), STEP, BOTH))


def test_contrasts_of_no_colour_of_light_are_left_out() -> None:
    """More red and green, but so much less blue that no lamp gives it."""
    light, flash = row((0.5, 0.5, 0.1), (0.3, 0.3, 0.2)), row((0.5, 0.5, 0.5), (0.5, 0.5, 0.5))

    assert not len(contrast(ratios_of(light, flash), places(0, 1), STEP, BOTH))


def test_places_of_other_colours_are_not_alike() -> None:
    flash = row((0.5, 0.5, 0.5), (0.505, 0.5, 0.495), (0.52, 0.5, 0.48))
    first = places(0, 0)

    exact, noisy = (ratios_of(flash, flash, v_f=v_f) for v_f in (1e-12, 1e-4))

    np.testing.assert_array_equal(exact.alike(first, places(1, 2)), [[True, False]])
    np.testing.assert_array_equal(noisy.alike(first, places(1, 2)), [[True, True]])


@pytest.mark.parametrize(("size", "length"), [(80, 1), (256, 3), (512, 6)])
def test_steps_grow_with_the_picture(size: int, length: int) -> None:
    found = steps((size // 2, size))

    assert found[:2] == [(length, 0), (0, length)]
    lengths = np.hypot(*np.array(found).T)
    assert len(set(found)) >= 4
    assert (np.abs(lengths - length) <= 0.71).all()
    assert all(dx >= 0 for dx, _ in found)


@pytest.mark.parametrize(
    ("shape", "expected"),
    [
        ((3, 300), {(4, 0), (2, -2), (2, 2), (3, 2)}),
        ((300, 3), {(0, 4), (2, -2), (2, 2), (2, 3)}),
        ((1, 300), {(4, 0)}),
    ],
)
def test_steps_end_within_the_narrowest_pictures(
    shape: tuple[int, int], expected: set[tuple[int, int]]
) -> None:
    assert set(steps(shape)) == expected


@pytest.mark.parametrize(("count", "total"), [(300, 125.0), (600, 250.0), (900, 250.0)])
def test_many_contrasts_count_no_more_than_some(count: int, total: float) -> None:
    x, u, covariance = (np.ones((count // 2, n)) for n in (3, 2, 3))
    half = Chromaticities(x, u, covariance, np.ones(count // 2))

    found = drawn([half, half], 400)

    assert len(found) == min(count, 400)
    assert found.weight.sum() == pytest.approx(total)


def test_of_no_contrasts_none_are_drawn() -> None:
    assert not len(drawn([], 400))

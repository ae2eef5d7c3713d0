from __future__ import annotations

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.matrixfit.chromaticities import (
    Chromaticities,
    by_colour,
    draw,
    nothing,
    sandwich,
    upper,
)


@pytest.mark.parametrize("count", [1, 7, 99, 100, 500])
def test_thinned_data_keep_their_weight(count: int) -> None:
    rng = np.random.default_rng(0)
    data = Chromaticities(
        rng.uniform(size=(100, 3)),
        rng.uniform(size=(100, 2)),
        rng.uniform(size=(100, 3)),
        rng.uniform(size=100),
    )

    found = data.thinned(count)

    assert len(found) == min(count, 100)
    assert found.weight.sum() == pytest.approx(data.weight.sum())
    assert {tuple(u) for u in found.u} <= {tuple(u) for u in data.u}


def test_nothing_has_no_data() -> None:
    assert len(nothing()) == len(nothing().thinned(5)) == 0
    assert nothing().weight.sum() == 0


def test_draws_follow_what_data_are_worth() -> None:
    worth = np.array([0.0, 3.0, 1.0, 0.0, 0.0, 4.0])

    np.testing.assert_array_equal(draw(worth, 6), np.arange(6))
    # rungs at 1, 3, 5, 7 of a ladder of 3, 4 and 8
    np.testing.assert_array_equal(draw(worth, 4), [1, 5])
    # and at 4/3, 4, 20/3
    np.testing.assert_array_equal(draw(worth, 3), [1, 2, 5])


def test_a_variance_between_matrices_is_a_product_of_matrices() -> None:
    rng = np.random.default_rng(3)
    left, right = rng.normal(size=(2, 5, 3, 3))
    variance = rng.uniform(size=(5, 3))

    found = sandwich(left, variance, right)

    expected = np.array(
        [a @ np.diag(v) @ b.T for a, v, b in zip(left, variance, right, strict=True)]
    )
    np.testing.assert_allclose(found, expected)
    np.testing.assert_array_equal(upper(found)[0], [found[0, 0, 0], found[0, 0, 1], found[0, 1, 1]])


def test_lamps_have_a_corner_on_the_surface_of_each_datum() -> None:
    surfaces = np.array([[0.2, 0.3, 0.5], [0.4, 0.4, 0.2]])
    data = Chromaticities(surfaces, np.zeros((2, 2)), np.zeros((2, 3)), np.ones(2))

    found = data.corners(np.stack([np.eye(3), np.diag([2.0, 1.0, 1.0])]))

    np.testing.assert_allclose(found[0], surfaces[:, :2])
    np.testing.assert_allclose(found[1], [[4 / 12, 3 / 12], [8 / 14, 4 / 14]])


def test_data_tell_the_third_chromaticity_and_how_sure_both_are() -> None:
    data = Chromaticities(
        np.ones((1, 3)) / 3, np.array([[0.5, 0.2]]), np.array([[4.0, 9.0, 2.0]]), np.ones(1)
    )

    np.testing.assert_allclose(data.light, [[0.5, 0.2, 0.3]])
    np.testing.assert_array_equal(data.variance, [6.0])


def test_chromaticities_change_with_the_flash_colour_as_finite_differences_do() -> None:
    """Of a lamp that multiplies channels by 2, 1 and 3."""
    gains, x = np.array([2.0, 1.0, 3.0]), np.array([0.3, 0.5, 0.2])

    def seen(colour: Floats64) -> Floats64:
        light = gains * colour
        return np.asarray(light / light.sum())

    u = seen(x)
    found = by_colour((np.eye(3) - u[:, None])[None], u[None], x[None])[0]

    step = 1e-6
    expected = np.stack([(seen(x + step * e) - seen(x - step * e)) / (2 * step) for e in np.eye(3)])
    np.testing.assert_allclose(found, expected.T, atol=1e-8)


def test_dim_channels_of_the_flash_tell_within_bounds() -> None:
    u, x = np.array([[0.5, 0.25, 0.25]]), np.array([[0.0, 0.5, 0.5]])

    found = by_colour(np.eye(3)[None], u, x)

    np.testing.assert_allclose(np.diag(found[0]), [25.0, 0.5, 0.5])

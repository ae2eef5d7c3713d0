from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.matrixfit import pools
from pipeline.matrixfit.chromaticities import Chromaticities
from pipeline.matrixfit.evidence import gather_evidence
from tests.reduced_pairs import HEIGHT, WIDTH, even, left_and_right, reduced_pair

NEAR, FAR = np.array([0.3, 0.2, 0.1]), np.array([0.2, 0.3, 0.3])
ACROSS = np.arange(WIDTH, dtype=float)[None, :, None] * np.ones((HEIGHT, 1, 1))
DOWN = np.arange(HEIGHT, dtype=float)[:, None, None] * np.ones((1, WIDTH, 1))


def pool(height: float = 8.0, at: tuple[float, float] = (WIDTH / 2, HEIGHT / 2)) -> Floats64:
    """What a lamp so many pixels before a wall gives it, 1 at most: (H, W, 1)."""
    squared = (ACROSS - at[0]) ** 2 + (DOWN - at[1]) ** 2
    return (1.0 + squared / height**2) ** -1.5


def slope() -> Floats64:
    """What a lamp far away gives it: ever more, not bent at all."""
    return 0.6 + 0.3 * ACROSS / WIDTH


def shown(light: Floats64, flash: Floats64 | None = None, **more: Any) -> Chromaticities:
    lit = even(0.5, 0.5, 0.5) if flash is None else flash
    return gather_evidence(reduced_pair(light * lit / 0.5, lit, **more, flash_only=True)).pools


def test_pools_are_the_lamp_that_is_near() -> None:
    found = shown(NEAR * pool() + FAR * slope())

    assert len(found) > 1000
    np.testing.assert_allclose(found.x, np.full((len(found), 3), 1 / 3))
    np.testing.assert_allclose(found.u, np.tile(NEAR[:2] / 0.6, (len(found), 1)), atol=1e-9)
    assert found.weight.sum() == pytest.approx(250)


def test_light_that_runs_straight_is_no_pool() -> None:
    assert not len(shown(NEAR * slope() + FAR * slope()[:, ::-1]))


def test_pools_that_overlap_are_mixtures_of_both() -> None:
    """Where one bends up and the other down the mixture lies beyond the corner of a lamp."""
    found = shown(NEAR * pool(at=(30, 20)) + FAR * pool(at=(50, 20)))

    a, b = NEAR[:2] / 0.6, FAR[:2] / 0.8
    along = (found.u - a) @ (b - a) / ((b - a) @ (b - a))
    np.testing.assert_allclose(found.u, a + along[:, None] * (b - a), atol=1e-9)
    assert along.min() < -0.05
    assert along.max() > 1.05
    # each is alone near its own middle
    assert np.mean(np.abs(along) < 0.05) > 0.1
    assert np.mean(np.abs(along - 1.0) < 0.05) > 0.1


@pytest.mark.parametrize(("bent", "some"), [(0.0, True), (0.001, True), (0.02, False)])
def test_round_things_have_no_pools(bent: float, some: bool) -> None:
    """The flash falls off around their middle: by .4 or 8 % over the two pixels next to it."""
    squared = (ACROSS - WIDTH / 2) ** 2 + (DOWN - HEIGHT / 2) ** 2

    found = shown(NEAR * pool() + FAR * slope(), even(0.5, 0.5, 0.5) * np.exp(-bent * squared))

    assert bool(len(found)) is some


@pytest.mark.parametrize(("colours", "some"), [(0.0, True), (0.02, False)])
def test_pools_are_of_one_surface(colours: float, some: bool) -> None:
    """Five colours by turns, so that no two places that are compared have the same."""
    turn = (ACROSS + 2 * DOWN) % 5
    flash = even(0.5, 0.5, 0.5) + colours * turn * (1, 0, -1)

    assert bool(len(shown(NEAR * pool() + FAR * slope(), flash))) is some


@pytest.mark.parametrize(("reach", "some"), [(2, False), (4, True)])
def test_what_lies_between_is_of_the_same_surface(
    reach: int, some: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every second pixel has another colour, so that halfway to a neighbour two away it changes."""
    monkeypatch.setattr(pools, "_REACHES", (reach,))
    flash = even(0.5, 0.5, 0.5) + 0.02 * ((ACROSS % 2) + 2 * (DOWN % 2)) * (1, 0, -1)

    assert bool(len(shown(NEAR * pool() + FAR * slope(), flash))) is some


@pytest.mark.parametrize("reaches", [(2,), (2, 4)])
def test_wide_bends_stand_out_from_more_noise(
    reaches: tuple[int, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pools, "_REACHES", reaches)
    light = NEAR * pool(12.0) + FAR * slope()

    assert bool(len(shown(light, no_flash_variance=3e-3**2))) is (4 in reaches)


@pytest.mark.parametrize(("strength", "some"), [(1.0, True), (0.05, False)])
def test_pools_are_bends_of_some_size(strength: float, some: bool) -> None:
    assert bool(len(shown(strength * NEAR * pool(16.0) + FAR * slope()))) is some


@pytest.mark.parametrize(("noise", "some"), [(1e-4, True), (2e-2, False)])
def test_pools_stand_out_from_noise(noise: float, some: bool) -> None:
    light = NEAR * pool() + FAR * slope()

    assert bool(len(shown(light, no_flash_variance=noise**2))) is some


def test_pools_where_something_is_not_usable_are_left_out() -> None:
    usable = np.zeros((HEIGHT, WIDTH), np.bool_)
    usable[::3, ::3] = True

    assert not len(shown(NEAR * pool() + FAR * slope(), usable=usable))


@pytest.mark.parametrize("shape", [(4, 4), (1, 9), (9, 1), (3, 90), (90, 3)])
def test_a_picture_smaller_than_a_pool_has_none(shape: tuple[int, int]) -> None:
    light = np.ones((*shape, 3)) * FAR

    found = gather_evidence(reduced_pair(light, np.full((*shape, 3), 0.5), flash_only=True))

    assert not len(found.pools)


def test_many_pools_are_thinned_alike(monkeypatch: pytest.MonkeyPatch) -> None:
    light = NEAR * pool() + FAR * slope()
    monkeypatch.setattr(pools, "_MOST", 20)

    one, other = shown(light), shown(light)

    # twelve directions and reaches, bends up and down
    assert len(one) <= 20 * 24
    np.testing.assert_array_equal(one.u, other.u)
    np.testing.assert_allclose(one.u, np.tile(NEAR[:2] / 0.6, (len(one), 1)), atol=1e-9)


@pytest.mark.parametrize(
    ("edge", "rendered", "height", "some"),
    [
        (False, False, 8.0, True),
        (False, False, 0.1, False),
        (False, True, 8.0, True),
        (True, False, 8.0, True),
        (True, False, 0.1, True),
        (True, True, 8.0, False),
    ],
)
def test_beside_edges_few_pools_count_and_none_of_a_rendering(
    edge: bool, rendered: bool, height: float, some: bool
) -> None:
    """A spot bends the light in a few pixels; what is surest beside edges has no pools."""
    shadow = left_and_right(even(*FAR), even(0, 0, 0) if edge else even(*FAR))
    light = NEAR * pool(height, at=(WIDTH / 4, 20)) + shadow + FAR
    pair = replace(reduced_pair(light, even(0.5, 0.5, 0.5), flash_only=True), rendered=rendered)

    found = gather_evidence(pair)

    assert found.has_edges is edge
    assert bool(len(found.pools)) is some
    assert bool(len(found.surest.pools)) is (some and not edge)
    assert found.surest.differences is found.differences


def test_pools_are_not_asked_where_round_things_have_terminators() -> None:
    """A lamp that ends at a column beside a pool elsewhere."""
    ends = 3.0 * FAR * np.maximum(WIDTH / 2 - ACROSS, 0.0) / WIDTH
    evidence = gather_evidence(
        reduced_pair(
            NEAR * pool(at=(WIDTH * 0.8, 20)) + ends + FAR, even(0.5, 0.5, 0.5), flash_only=True
        )
    )

    assert len(evidence.terminators)
    assert not len(evidence.pools)


@pytest.mark.parametrize(("height", "some"), [(0.1, False), (8.0, True)])
def test_few_pools_are_chance(height: float, some: bool) -> None:
    """A spot bends the light in a few pixels, and a twentieth of them is asked."""
    assert bool(len(shown(NEAR * pool(height) + FAR * slope()))) is some


@pytest.mark.parametrize("order", [[0, 1, 2], [2, 1, 0]])
def test_pools_in_the_light_of_all_three_lamps_are_coves(order: list[int]) -> None:
    """Every lamp has more than a tenth: on two surfaces, of which one halves all green light."""
    matrices = np.array([np.diag(rgb) for rgb in ([6.0, 3, 1], [3, 5, 2], [1, 3, 6])])[order]
    shares = np.array([[0.12, 0.5, 0.38], [0.08, 0.5, 0.42], [1, 0, 0], [0.6, 0.6, -0.2]])
    x = np.repeat([[1 / 3, 1 / 3, 1 / 3], [0.4, 0.2, 0.4]], len(shares), axis=0)
    light = np.einsum("jkl,nl->jnk", matrices[np.argsort(order)], x)
    corners = light[..., :2] / light.sum(axis=2, keepdims=True)
    u = np.einsum("nj,jni->ni", np.tile(shares, (2, 1)), corners)
    data = Chromaticities(x, u, np.zeros((8, 3)), np.arange(8.0))

    found = pools.without_coves(data, matrices)

    assert found.weight.tolist() == [1, 2, 3, 5, 6, 7]
    np.testing.assert_array_equal(found.u, u[[1, 2, 3, 5, 6, 7]])

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.errors import UnusablePairError
from pipeline.hui2018.lights import invariants_of_pair, lights_of_pair, published_lights
from pipeline.light.model import Model
from pipeline.pair.reduced import reduce_pair
from pipeline.vectors import unit
from tests.unit.pipeline.hui2018.known_lights import LIGHTS, worst_angle


def mixtures(lights: Floats64, count: int = 4000) -> Floats64:
    """Unit mixtures, a tenth of them of each light alone."""
    rng = np.random.default_rng(4)
    z = rng.dirichlet(np.ones(len(lights)), count)
    pure = count // 10
    for j in range(len(lights)):
        z[j * pure : (j + 1) * pure] = np.eye(len(lights))[j]
    return unit(z @ lights)


@pytest.mark.parametrize("which", [[0], [0, 2], [0, 1], [0, 1, 2]])
def test_lights_are_found_from_their_mixtures(which: list[int]) -> None:
    found = published_lights(mixtures(LIGHTS[which]), len(which))

    assert found.shape == (len(which), 3)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1)
    assert worst_angle(found, LIGHTS[which]) < 0.1


@pytest.mark.parametrize("count", [2, 3])
def test_stray_invariants_are_pruned_first(count: int) -> None:
    """Strays alone in their bins would pull either estimate away, were they not pruned."""
    lights = LIGHTS[[0, 2]] if count == 2 else LIGHTS
    center = unit(lights.mean(axis=0))
    line = np.linspace(-2, 2, 9)[:, None] * (lights[-1] - lights[0])
    strays = unit(center + line[np.abs(line).max(axis=1) > 0.3])

    found = published_lights(np.concatenate([mixtures(lights), strays]), count)

    assert worst_angle(found, lights) < 0.5


def test_one_light_is_the_mean_direction() -> None:
    pair = unit(np.array([[0.1, 0.0, 1.0], [-0.1, 0.0, 1.0], [0.0, 0.1, 1.0], [0.0, -0.1, 1.0]]))

    found = published_lights(np.repeat(pair, 10, axis=0), 1)

    np.testing.assert_allclose(found, [[0, 0, 1]], atol=1e-12)


def test_missing_invariants_have_no_say() -> None:
    gammas = mixtures(LIGHTS)
    missing = np.array([[np.nan, 0.5, 0.5], [0.0, 0.0, 0.0], [np.inf, 0.0, 1.0]])

    found = published_lights(np.concatenate([missing, gammas, missing]), 3)

    np.testing.assert_array_equal(found, published_lights(gammas, 3))


@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize(
    "gammas",
    [
        np.empty((0, 3)),
        LIGHTS[:2],
        LIGHTS,
        np.full((500, 3), np.nan),
        np.zeros((500, 3)),
    ],
    ids=["none", "two", "three apart", "NaN", "zero"],
)
def test_too_few_invariants_are_refused_with_a_sentence(gammas: Floats64, count: int) -> None:
    with pytest.raises(UnusablePairError, match="hardly any pixel agrees with that of another"):
        published_lights(gammas, count)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_equal_invariants_give_that_light(count: int) -> None:
    found = published_lights(np.repeat(LIGHTS[:1], 300, axis=0), count)

    np.testing.assert_allclose(found, np.repeat(LIGHTS[:1], count, axis=0), atol=1e-4)


@pytest.mark.parametrize("count", [0, 4, -1])
def test_other_numbers_are_refused(count: int) -> None:
    with pytest.raises(ValueError, match=f"not {count}"):
        published_lights(mixtures(LIGHTS), count)


# pairs


@pytest.mark.parametrize("which", [[0], [0, 2], [0, 1, 2]])
def test_lights_of_a_pair_are_found_in_the_coordinates_of_the_model(
    model: Model,
    exact: Callable[..., tuple[Any, Floats64]],
    warm_to_cool: Floats64,
    which: list[int],
) -> None:
    pair, _ = exact(warm_to_cool[which])

    found = lights_of_pair(reduce_pair(pair), model, len(which))

    assert worst_angle(found, warm_to_cool[which]) < 1


def test_the_published_coordinates_decide_about_the_triangle(
    model: Model, warm_to_cool: Floats64, surfaces: Floats64, pair_of: Callable[..., Any]
) -> None:
    """Without pure pixels the smallest triangle is another in other coordinates."""
    rows = np.random.default_rng(7).integers(0, len(surfaces), (60, 90))
    z = np.random.default_rng(8).dirichlet(2 * np.ones(3), rows.shape)
    flash = surfaces[rows]
    light = np.einsum("klj,hwj,hwl->hwk", model.tensor, z @ warm_to_cool, flash)
    reduced = reduce_pair(pair_of(light, flash))

    published = lights_of_pair(reduced, model, 3)
    others = lights_of_pair(reduced, replace(model, published=np.eye(3)), 3)

    assert worst_angle(published, others) > 0.5


def test_invariants_of_a_pair_are_those_of_its_usable_pixels(
    model: Model, exact: Callable[..., tuple[Any, Floats64]], warm_to_cool: Floats64
) -> None:
    pair, _ = exact(warm_to_cool[:1])
    pair.unusable[:4] = True
    reduced = reduce_pair(pair)

    found = invariants_of_pair(reduced, model)

    assert found.shape == (np.count_nonzero(reduced.usable), 3)
    expected = unit(model.published @ warm_to_cool[0])
    np.testing.assert_allclose(found, np.tile(expected, (len(found), 1)), atol=1e-4)

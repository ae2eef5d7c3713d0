from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.errors import UnusablePairError
from pipeline.light.model import Model
from pipeline.matrixfit import starts
from pipeline.matrixfit.chromaticities import nothing
from pipeline.matrixfit.evidence import gather_evidence
from pipeline.matrixfit.starts import invariants, start_points
from pipeline.pair.reduced import reduce_pair
from pipeline.vectors import unit

SETS = [(0,), (2,), (0, 2), (0, 1), (1, 2), (0, 1, 2)]


def off(candidates: Floats64, lamps: Floats64) -> Floats64:
    """Angle in degrees from each lamp to the nearest candidate."""
    return np.asarray(np.degrees(np.arccos(np.clip(lamps @ candidates.T, -1, 1))).min(axis=1))


@pytest.mark.parametrize("which", SETS)
def test_the_true_lamps_are_among_the_candidates(
    shadowed: Callable[[Floats64], Any],
    model: Model,
    warm_to_cool: Floats64,
    which: tuple[int, ...],
) -> None:
    true = warm_to_cool[list(which)]
    evidence = gather_evidence(reduce_pair(shadowed(true)))

    found = start_points(evidence, model.tensor)

    assert off(found, true).max() < 0.6
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1)
    assert len(found) <= 30


@pytest.mark.parametrize("which", [(0, 2), (0, 1, 2)])
def test_without_shadows_the_outermost_pixels_tell(
    exact: Callable[..., Any], model: Model, warm_to_cool: Floats64, which: tuple[int, ...]
) -> None:
    true = warm_to_cool[list(which)]
    evidence = gather_evidence(reduce_pair(exact(true)[0]))
    assert not len(evidence.differences)

    assert off(start_points(evidence, model.tensor), true).max() < 1.5


def test_pools_of_light_are_candidates(
    exact: Callable[..., Any], model: Model, warm_to_cool: Floats64
) -> None:
    evidence = gather_evidence(reduce_pair(exact(warm_to_cool[[0, 2]])[0]))
    between = unit(0.7 * warm_to_cool[0] + 0.3 * warm_to_cool[2])
    alone = evidence.pixels.x @ model.lamp_matrix(between).T
    u = alone[:, :2] / alone.sum(axis=1, keepdims=True)
    pools = replace(evidence.pixels, u=u)

    found = [
        off(start_points(replace(evidence, pools=some), model.tensor), between[None])[0]
        for some in (nothing(), pools)
    ]

    assert found[0] > 0.7
    assert found[1] < 0.35


def test_candidates_are_unlike_each_other(
    shadowed: Callable[[Floats64], Any], model: Model, warm_to_cool: Floats64
) -> None:
    evidence = gather_evidence(reduce_pair(shadowed(warm_to_cool)))

    found = start_points(evidence, model.tensor)

    cosines = found @ found.T - 2 * np.eye(len(found))
    assert np.degrees(np.arccos(cosines.max())) > 1.499


def test_candidates_are_the_same_every_time(
    shadowed: Callable[[Floats64], Any], model: Model, warm_to_cool: Floats64
) -> None:
    evidence = gather_evidence(reduce_pair(shadowed(warm_to_cool)))

    first, second = (start_points(evidence, model.tensor) for _ in range(2))

    np.testing.assert_array_equal(first, second)


def test_invariants_of_one_lamp_are_its_coefficients(
    exact: Callable[..., Any], model: Model, warm_to_cool: Floats64
) -> None:
    evidence = gather_evidence(reduce_pair(exact(warm_to_cool[1])[0]))

    found = invariants(evidence.pixels, model.tensor)

    assert len(found) == len(evidence.pixels)
    np.testing.assert_allclose(found, np.tile(warm_to_cool[1], (len(found), 1)), atol=1e-4)


@pytest.mark.parametrize("gammas", [np.zeros((0, 3)), np.eye(3).repeat(100, axis=0)])
def test_a_model_that_makes_no_sense_of_any_pixel_is_an_error(
    exact: Callable[..., Any],
    model: Model,
    warm_to_cool: Floats64,
    monkeypatch: pytest.MonkeyPatch,
    gammas: Floats64,
) -> None:
    """No pixel can be solved, or all are solved and have no middle."""
    evidence = gather_evidence(reduce_pair(exact(warm_to_cool)[0]))
    monkeypatch.setattr(starts, "invariants", lambda *_: gammas)

    with pytest.raises(UnusablePairError, match="hardly any pixel agrees"):
        start_points(evidence, model.tensor)

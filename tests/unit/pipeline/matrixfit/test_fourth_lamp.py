from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.light.model import Model
from pipeline.matrixfit.chromaticities import nothing
from pipeline.matrixfit.evidence import Evidence, gather_evidence
from pipeline.matrixfit.fourth_lamp import gain_of_fourth
from pipeline.pair.reduced import reduce_pair
from pipeline.vectors import unit

FOURTH = np.array([[0.69, 0.3, 0.65]])


@pytest.fixture
def four(warm_to_cool: Floats64) -> Floats64:
    return np.vstack([warm_to_cool, FOURTH])


@pytest.fixture
def seen(shadowed: Callable[[Floats64], Any]) -> Callable[[Floats64], Evidence]:
    """Evidence of lamps that cast hard shadows."""

    def of(lamps: Floats64) -> Evidence:
        pair = shadowed(lamps)
        return gather_evidence(reduce_pair(pair))

    return of


def test_three_lamps_leave_no_room_for_a_fourth(
    seen: Callable[[Floats64], Evidence], model: Model, warm_to_cool: Floats64
) -> None:
    assert gain_of_fourth(seen(warm_to_cool), model, model.lamp_matrix(warm_to_cool)) < 30


def test_a_fourth_lamp_is_missed_by_its_three_fellows(
    seen: Callable[[Floats64], Evidence], model: Model, four: Floats64, warm_to_cool: Floats64
) -> None:
    assert gain_of_fourth(seen(four), model, model.lamp_matrix(warm_to_cool)) > 100


def test_a_light_that_is_there_already_gains_nothing(
    seen: Callable[[Floats64], Evidence], model: Model, warm_to_cool: Floats64
) -> None:
    gain = gain_of_fourth(seen(warm_to_cool[:1]), model, model.lamp_matrix(warm_to_cool))

    assert gain == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize("sign", [1, -1])  # a fit's matrices may have either
@pytest.mark.parametrize(("degrees", "told"), [(2.5, False), (4.5, True)])
def test_a_light_in_a_lamps_own_colours_is_no_fourth(
    seen: Callable[[Floats64], Evidence],
    model: Model,
    warm_to_cool: Floats64,
    degrees: float,
    told: bool,
    sign: int,
) -> None:
    """So near, it is the lamp itself on a surface whose colours the model misses."""
    away = unit(FOURTH[0] - warm_to_cool[0] * (FOURTH[0] @ warm_to_cool[0]))
    angle = np.radians(degrees)
    near = np.cos(angle) * warm_to_cool[0] + np.sin(angle) * away

    gain = gain_of_fourth(
        seen(np.vstack([warm_to_cool, near])), model, sign * model.lamp_matrix(warm_to_cool)
    )

    assert (gain > 100) is told


def test_without_edges_of_shadows_nothing_is_said(
    seen: Callable[[Floats64], Evidence], model: Model, four: Floats64, warm_to_cool: Floats64
) -> None:
    evidence = seen(four)

    gain = gain_of_fourth(
        replace(evidence, differences=nothing()), model, model.lamp_matrix(warm_to_cool)
    )

    assert gain == 0


@pytest.mark.parametrize("lit_by_four", [False, True])
def test_edges_and_pools_count_alike(
    seen: Callable[[Floats64], Evidence],
    model: Model,
    four: Floats64,
    warm_to_cool: Floats64,
    lit_by_four: bool,
) -> None:
    """What one kind of data says of a fourth lamp counts for a half where there are both."""
    evidence, three = seen(four).surest, model.lamp_matrix(warm_to_cool)
    other = seen(four if lit_by_four else warm_to_cool).differences

    gain = gain_of_fourth(replace(evidence, pools=other), model, three)

    alone = [
        gain_of_fourth(replace(evidence, differences=one), model, three)
        for one in (evidence.differences, other)
    ]
    assert gain == pytest.approx(np.mean(alone), rel=0.01)
    assert alone[0] > 100
    assert (alone[1] > 100) is lit_by_four


@pytest.mark.parametrize(("least", "told"), [(0.12, False), (0.08, True)])
@pytest.mark.parametrize("turned", [1, -1])
def test_what_bends_in_the_light_of_all_three_is_no_fourth(
    seen: Callable[[Floats64], Evidence],
    model: Model,
    warm_to_cool: Floats64,
    least: float,
    told: bool,
    turned: int,
) -> None:
    """As along a cove; pools that one of the three hardly has are more than a bend."""
    evidence, three = seen(warm_to_cool).surest, model.lamp_matrix(warm_to_cool)[::turned]
    data = evidence.differences
    mixed = np.einsum("j,jni->ni", [least, 0.5, 0.5 - least], data.corners(three))

    gain = gain_of_fourth(replace(evidence, pools=replace(data, u=mixed)), model, three)

    assert (gain > 50) is told

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.lamps.light_in_shadows import light_in_shadows
from tests.reduced_pairs import HEIGHT, even, left_and_right, reduced_pair

Build = Callable[..., Any]

WARM, COOL, GREEN = np.diag([1.0, 0.6, 0.3]), np.diag([0.4, 0.7, 1.0]), np.diag([0.3, 1.0, 0.4])
FLASH = np.array([0.5, 0.4, 0.3])


def lit(*shines: tuple[float, Floats64]) -> Floats64:
    """An even picture under lamps of some strengths."""
    return even(*sum(strength * matrix @ FLASH for strength, matrix in shines))


@pytest.fixture
def found(lamps_of: Build, warm_to_cool: Floats64) -> Callable[..., Floats64]:
    """What is left of lamps of these matrices, where a photograph shows this light."""

    def find(light: Floats64, *matrices: Floats64) -> Floats64:
        lamps = lamps_of(warm_to_cool[: len(matrices)], matrices=np.stack(matrices))
        return light_in_shadows(reduced_pair(light, even(*FLASH), flash_only=True), lamps)

    return find


@pytest.mark.parametrize("left", [0.0, 0.15, 0.4])
def test_what_a_lamp_gives_to_its_shadow_is_relative_to_its_light_beside_it(
    found: Callable[..., Floats64], left: float
) -> None:
    """The warm lamp of strength 0.8 is shadowed on the right, where so much of it is left."""
    light = left_and_right(lit((0.8, WARM), (0.5, COOL)), lit((0.8 * left, WARM), (0.5, COOL)))

    np.testing.assert_allclose(found(light, WARM, COOL), [left, 0.0], atol=1e-5)


def test_each_of_three_lamps_has_its_own(found: Callable[..., Floats64]) -> None:
    """The cool lamp leaves a tenth of its light in its shadow on the right."""
    light = left_and_right(
        lit((0.6, WARM), (0.7, COOL), (0.2, GREEN)),
        lit((0.6, WARM), (0.07, COOL), (0.2, GREEN)),
    )

    np.testing.assert_allclose(found(light, WARM, COOL, GREEN), [0.0, 0.1, 0.0], atol=1e-4)


@pytest.mark.parametrize(("rim", "left"), [(0, 0.1), (HEIGHT // 3, 0.1), (HEIGHT, 0.5)])
def test_the_deepest_quarter_of_the_shadows_counts(
    found: Callable[..., Floats64], rim: int, left: float
) -> None:
    """Rims of shadows are half lit; what has no more than a rim passes for indirect."""
    shadow = lit((0.08, WARM), (0.5, COOL))
    shadow[:rim] = lit((0.4, WARM), (0.5, COOL))[0, 0]
    light = left_and_right(lit((0.8, WARM), (0.5, COOL)), shadow)

    assert found(light, WARM, COOL)[0] == pytest.approx(left, abs=1e-4)


def test_edges_at_which_no_lamp_goes_alone_tell_nothing(found: Callable[..., Floats64]) -> None:
    """Both lamps go at once, so that the difference shows neither."""
    light = left_and_right(lit((0.8, WARM), (0.8, COOL)), lit((0.2, WARM), (0.2, COOL)))

    np.testing.assert_array_equal(found(light, WARM, COOL), [0.0, 0.0])


@pytest.mark.parametrize(("rows", "tells"), [(3, False), (HEIGHT, True)])
def test_few_edges_tell_nothing(found: Callable[..., Floats64], rows: int, tells: bool) -> None:
    light = lit((0.8, WARM), (0.5, COOL))
    light[:rows, -3:] = lit((0.4, WARM), (0.5, COOL))[0, 0]

    assert bool(found(light, WARM, COOL)[0] > 0) is tells


def test_light_without_shadows_tells_nothing(found: Callable[..., Floats64]) -> None:
    np.testing.assert_array_equal(found(lit((0.8, WARM), (0.5, COOL)), WARM, COOL), [0.0, 0.0])

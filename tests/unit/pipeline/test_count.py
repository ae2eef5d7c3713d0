from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.count import count_lamps
from pipeline.model import Model
from pipeline.noise import Noise
from pipeline.reduced import reduce_pair

Array = NDArray[np.float64]


@pytest.fixture
def counted(model: Model, warm_to_cool: Array) -> Callable[..., tuple[int, float]]:
    """Count the lamps of a pair, told first guesses that are some way off the truth."""

    def count(
        pair: Any,
        one: Array | None = None,
        two: Array | None = None,
        rendered: bool = False,
    ) -> tuple[int, float]:
        reduced = reduce_pair(pair)
        first = warm_to_cool.mean(axis=0) if one is None else one
        ends = warm_to_cool[[0, 2]] if two is None else two
        return count_lamps(reduced, model.lamp_matrix(first), model.lamp_matrix(ends), rendered)

    return count


def test_one_matrix_is_one_lamp(
    counted: Callable[..., tuple[int, float]],
    exact: Callable[..., tuple[Any, Array]],
    warm_to_cool: Array,
) -> None:
    for coefficients in warm_to_cool:
        pair, _ = exact(coefficients)

        found, confidence = counted(pair)

        assert found == 1
        assert 0.9 < confidence <= 1


def test_one_lamp_need_not_fit_the_model(
    counted: Callable[..., tuple[int, float]],
    pair_of: Callable[..., Any],
    flash_part: NDArray[np.float32],
) -> None:
    """Any 3×3 matrix will do, even one that no lamp of the model has."""
    matrix = np.array([[0.8, 0.15, 0.0], [0.1, 0.4, 0.1], [0.0, 0.2, 0.3]])

    assert counted(pair_of(flash_part @ matrix.T, flash_part))[0] == 1


@pytest.mark.parametrize("which", [(0, 2), (0, 1), (1, 2)])
@pytest.mark.parametrize("rendered", [False, True])
def test_two_matrices_are_two_lamps(
    counted: Callable[..., tuple[int, float]],
    exact: Callable[..., tuple[Any, Array]],
    warm_to_cool: Array,
    which: tuple[int, int],
    rendered: bool,
) -> None:
    ends = warm_to_cool[list(which)]
    pair, _ = exact(ends)

    found, confidence = counted(pair, ends.mean(axis=0), 0.9 * ends + 0.1 * ends[::-1], rendered)

    assert found == 2
    assert 0.8 < confidence <= 1


def test_three_matrices_are_three_lamps(
    counted: Callable[..., tuple[int, float]],
    exact: Callable[..., tuple[Any, Array]],
    warm_to_cool: Array,
) -> None:
    pair, _ = exact(warm_to_cool)

    found, confidence = counted(pair)

    assert found == 3
    assert 0.8 < confidence <= 1


def test_nearly_equal_lamps_count_as_one_and_less_surely(
    counted: Callable[..., tuple[int, float]],
    exact: Callable[..., tuple[Any, Array]],
    warm_to_cool: Array,
) -> None:
    warm, _, cool = warm_to_cool
    confidences = []
    for part in (0.0, 0.02, 0.05):
        pair, _ = exact(np.array([warm, (1 - part) * warm + part * cool]))
        found, confidence = counted(pair)
        assert found == 1
        confidences.append(confidence)

    assert confidences == sorted(confidences, reverse=True)


def test_noise_that_is_known_does_not_make_a_lamp(
    counted: Callable[..., tuple[int, float]],
    pair_of: Callable[..., Any],
    exact: Callable[..., tuple[Any, Array]],
    warm_to_cool: Array,
) -> None:
    clean, _ = exact(warm_to_cool[0])
    drawn = np.random.default_rng(5).normal(0, 0.003, clean.no_flash.shape)
    noisy, part = clean.no_flash + drawn, clean.flash - clean.no_flash
    noise = Noise(np.full(3, 1e-8), np.full(3, 0.003**2))

    assert counted(pair_of(noisy, part, no_flash_noise=noise, flash_noise=noise))[0] == 1
    assert counted(pair_of(noisy, part))[0] > 1


def test_rendered_pictures_may_leave_more(
    counted: Callable[..., tuple[int, float]],
    exact: Callable[..., tuple[Any, Array]],
    warm_to_cool: Array,
) -> None:
    """Between the limits for sensor values and for rendered ones lies a third lamp that is weak."""
    counts = []
    for part in np.linspace(0.0, 1.0, 6):
        third = (1 - part) * (warm_to_cool[0] + warm_to_cool[2]) / 2 + part * warm_to_cool[1]
        pair, _ = exact(np.array([warm_to_cool[0], warm_to_cool[2], third]))
        counts.append([counted(pair, rendered=rendered)[0] for rendered in (False, True)])

    assert counts[0] == [2, 2]
    assert counts[-1] == [3, 3]
    assert [2, 3] not in counts
    assert [3, 2] in counts


def test_counting_is_the_same_every_time(
    counted: Callable[..., tuple[int, float]],
    exact: Callable[..., tuple[Any, Array]],
    warm_to_cool: Array,
) -> None:
    pair, _ = exact(warm_to_cool)

    assert counted(pair) == counted(pair)

from __future__ import annotations

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.matrixfit.minimum import minimum

EXACT = 2e-9


def rosenbrock(x: Floats64) -> tuple[float, Floats64]:
    """Rosenbrock's curved valley, lowest at 1, 1, …."""
    rise, off = x[1:] - x[:-1] ** 2, 1.0 - x[:-1]
    gradient = np.zeros_like(x)
    gradient[1:] += 200.0 * rise
    gradient[:-1] -= 400.0 * rise * x[:-1] + 2.0 * off
    return float((100.0 * rise**2 + off**2).sum()), gradient


def test_follows_a_curved_valley_to_its_end() -> None:
    found, _ = minimum(rosenbrock, np.full(4, 0.0), 100, EXACT)
    np.testing.assert_allclose(found.x, 1.0, atol=1e-4)
    assert found.value < 1e-8


def test_a_square_of_n_variables_takes_little_more_than_n_steps() -> None:
    scales = np.array([1.0, 10.0, 100.0])
    calls = []

    def square(x: Floats64) -> tuple[float, Floats64]:
        calls.append(x)
        return float(0.5 * scales @ (x - 2.0) ** 2), scales * (x - 2.0)

    found, _ = minimum(square, np.array([5.0, -3.0, 4.0]), 100, EXACT)
    np.testing.assert_allclose(found.x, 2.0, atol=1e-5)
    assert len(calls) < 25


def test_what_is_known_of_the_function_makes_a_search_shorter() -> None:
    calls = []

    def counted(x: Floats64) -> tuple[float, Floats64]:
        calls.append(x)
        return rosenbrock(x)

    start = np.full(4, 0.0)
    found, inverse = minimum(counted, start, 100, EXACT)
    first = len(calls)
    again, _ = minimum(counted, found.x + 0.01, 100, EXACT, inverse=inverse)
    np.testing.assert_allclose(again.x, 1.0, atol=1e-4)
    known = len(calls) - first
    minimum(counted, found.x + 0.01, 100, EXACT)
    assert known < len(calls) - first - known


def test_ends_where_a_step_gains_little() -> None:
    start = np.full(4, 0.0)
    values = [minimum(rosenbrock, start, 100, little)[0].value for little in (0.1, 1e-3, EXACT)]
    assert values[0] > 10 * values[1] > 100 * values[2]


def test_ends_after_the_steps_that_it_is_given_and_lower_with_each() -> None:
    start = np.array([-1.2, 1.0])
    values = [minimum(rosenbrock, start, steps, EXACT)[0].value for steps in range(6)]
    assert values[0] == rosenbrock(start)[0]
    assert values == sorted(values, reverse=True) and len(set(values)) == 6


@pytest.mark.parametrize("start", [0.1, 3.0, 50.0])
def test_steps_back_from_where_there_is_no_value(start: float) -> None:
    def barrier(x: Floats64) -> tuple[float, Floats64]:
        if x[0] <= 0:
            return np.inf, np.zeros(1)
        return float(x[0] - np.log(x[0])), 1.0 - 1.0 / x

    assert minimum(barrier, np.array([start]), 100, EXACT)[0].x[0] == pytest.approx(1.0, abs=1e-4)


def test_stays_at_a_minimum_and_where_nothing_is_lower() -> None:
    level, _ = minimum(lambda _: (3.0, np.zeros(2)), np.array([1.0, 2.0]), 10, EXACT)
    assert level.x.tolist() == [1.0, 2.0] and level.value == 3.0
    wrong, _ = minimum(lambda x: (float(x @ x), -2.0 * x), np.array([1.0, 2.0]), 10, EXACT)
    assert wrong.x.tolist() == [1.0, 2.0]

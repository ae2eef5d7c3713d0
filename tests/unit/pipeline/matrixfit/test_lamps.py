from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pipeline.lamps import Lamps, estimate_lamps
from pipeline.matrixfit.lamps import fit_lamps
from pipeline.model import Model
from pipeline.reduced import reduce_pair


def angles(found: Lamps, true: np.ndarray) -> np.ndarray:
    cosine = (found.coefficients * true).sum(axis=1) / np.linalg.norm(true, axis=1)
    return np.asarray(np.degrees(np.arccos(np.clip(cosine, -1, 1))))


@pytest.fixture
def two(warm_to_cool: np.ndarray) -> np.ndarray:
    return np.asarray(warm_to_cool)[[0, -1]]


def test_exact_lamps_are_found(model: Model, exact: Callable[..., Any], two: np.ndarray) -> None:
    pair, _ = exact(two)
    reduced = reduce_pair(pair)
    start = estimate_lamps(reduced, model, 2, False)

    found = fit_lamps(start, reduced, False, model)

    assert angles(found, two).max() < 2.5
    np.testing.assert_allclose(np.linalg.norm(found.coefficients, axis=1), 1)
    whites = found.matrices @ model.flash_white
    np.testing.assert_allclose(whites, found.coefficients, atol=1e-9)


def test_the_same_pair_gives_the_same_lamps(
    model: Model, exact: Callable[..., Any], two: np.ndarray
) -> None:
    reduced = reduce_pair(exact(two)[0])
    start = estimate_lamps(reduced, model, 2, False)

    first, second = (fit_lamps(start, reduced, False, model) for _ in range(2))

    np.testing.assert_array_equal(first.matrices, second.matrices)


@pytest.mark.parametrize("count", [1, 3])
def test_one_lamp_and_three_stay_as_they_were(
    model: Model, exact: Callable[..., Any], two: np.ndarray, count: int
) -> None:
    reduced = reduce_pair(exact(two)[0])
    lamps = estimate_lamps(reduced, model, count, False)  # type: ignore[arg-type]  # of numbers

    assert fit_lamps(lamps, reduced, False, model) is lamps


def test_without_usable_pixels_the_lamps_stay(
    model: Model, exact: Callable[..., Any], two: np.ndarray
) -> None:
    reduced = reduce_pair(exact(two)[0])
    lamps = estimate_lamps(reduced, model, 2, False)
    blind = replace(reduced, usable=np.zeros_like(reduced.usable))

    assert fit_lamps(lamps, blind, False, model) is lamps

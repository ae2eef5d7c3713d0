from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import cho_factor

from pipeline.photometric_stereo.equations import Pattern, Rows


def rows_of(seed: int, n: int, r: int, k: int) -> Rows:
    random = np.random.default_rng(seed)
    return Rows(
        random.standard_normal((n, r, k)),
        random.uniform(0.5, 2.0, (n, r)),
        random.standard_normal((n, r)),
    )


PAIRS = np.array([[0, 1], [1, 2], [2, 3], [1, 2]])
TRIPLES = np.array([[0, 2, 4], [4, 3, 1]])
KINDS = (rows_of(1, 4, 3, 2), rows_of(2, 2, 2, 3))


def stacked() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Derivatives (14, 5), precision and residual of all rows one below the other."""
    by, precision, residual = [], [], []
    for places, rows in ((PAIRS, KINDS[0]), (TRIPLES, KINDS[1])):
        for group, one, weights, off in zip(
            places, rows.by, rows.precision, rows.residual, strict=True
        ):
            wide = np.zeros((len(one), 5))
            wide[:, group] = one
            by.append(wide)
            precision.append(weights)
            residual.append(off)
    return np.concatenate(by), np.concatenate(precision), np.concatenate(residual)


def test_the_solution_is_that_of_least_squares() -> None:
    by, precision, residual = stacked()

    found = Pattern(5, PAIRS, TRIPLES).equations(*KINDS).solution()

    root = np.sqrt(precision)
    expected = np.linalg.lstsq(root[:, None] * by, -root * residual, rcond=None)[0]
    np.testing.assert_allclose(found, expected, rtol=1e-6)


@pytest.mark.parametrize("scale", [0.001, 1.0, 1000.0])
def test_a_border_is_solved_for_together_with_the_rest(scale: float) -> None:
    by, precision, residual = stacked()
    outer = np.random.default_rng(3).standard_normal((len(by), 4)) * (scale, 1.0, 1.0, 1.0)
    weighed = precision[:, None] * outer
    equations = Pattern(5, PAIRS, TRIPLES).equations(*KINDS)

    inner, found = equations.solution_with(by.T @ weighed, outer.T @ weighed, -weighed.T @ residual)

    root = np.sqrt(precision)
    both = root[:, None] * np.concatenate([by, outer], axis=1)
    expected = np.linalg.lstsq(both, -root * residual, rcond=None)[0]
    np.testing.assert_allclose(np.concatenate([inner, found]), expected, rtol=1e-6)
    with pytest.raises(np.linalg.LinAlgError):
        equations.solution_with(by.T @ weighed, -outer.T @ weighed, -weighed.T @ residual)


@pytest.mark.parametrize(
    ("prior", "rounds", "at_once"), [(0.0, 30, True), (1e4, 29, False), (0.0, 5, True)]
)
def test_a_wide_border_is_solved_for_as_exactly_as_the_rest(
    prior: float, rounds: int, at_once: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Surfaces end elsewhere where steps are a millionth off. A prior makes for few rounds."""
    monkeypatch.setattr("pipeline.photometric_stereo.equations._ROUNDS", rounds)
    places = np.array([[i, i + 1] for i in range(40)])
    rows = rows_of(1, 40, 3, 2)
    by = np.zeros((40, 3, 41))
    for one, pair, small in zip(by, places, rows.by, strict=True):
        one[:, pair] = small
    both = np.concatenate([by.reshape(120, 41), rows_of(4, 40, 3, 30).by.reshape(120, 30)], axis=1)
    weighed = rows.precision.ravel()[:, None] * both
    normal, downhill = both.T @ weighed, -weighed.T @ rows.residual.ravel()
    normal[41:, 41:] += prior * np.eye(30)
    equations = Pattern(41, places, np.zeros((0, 3), np.intp)).equations(rows, rows_of(2, 0, 2, 3))
    factored: list[int] = []

    def noted(matrix: np.ndarray) -> tuple[np.ndarray, bool]:
        factored.append(len(matrix))
        found: tuple[np.ndarray, bool] = cho_factor(matrix)
        return found

    monkeypatch.setattr("pipeline.photometric_stereo.equations.cho_factor", noted)

    step = equations.solution_with(normal[:41, 41:], normal[41:, 41:], downhill[41:])

    error = np.concatenate(step) - np.linalg.solve(normal, downhill)
    assert np.linalg.norm(error) < 1e-7 * np.linalg.norm(step[0])
    assert len(factored) == (rounds < 30) + at_once  # the corner, what is left of it


def test_a_pattern_serves_for_other_values() -> None:
    pattern = Pattern(5, PAIRS, TRIPLES)
    pattern.equations(rows_of(7, 4, 3, 2), rows_of(8, 2, 2, 3))

    again = pattern.equations(*KINDS).solution()

    assert again == pytest.approx(Pattern(5, PAIRS, TRIPLES).equations(*KINDS).solution())


def test_unknowns_are_ordered_so_that_factors_fill_up_little() -> None:
    """Solved for first, the one that all others hang on would tie all of them together."""
    spokes = np.array([[0, i] for i in range(1, 30)])

    equations = Pattern(30, spokes).equations(rows_of(1, 29, 3, 2))

    assert equations._factors.L.nnz == 30 + 29  # as many as there are entries, of 465


def test_an_unknown_that_no_row_tells_does_not_move() -> None:
    found = Pattern(6, PAIRS, TRIPLES).equations(*KINDS).solution()

    assert found[5] == 0
    np.testing.assert_allclose(
        found[:5], Pattern(5, PAIRS, TRIPLES).equations(*KINDS).solution(), rtol=1e-6
    )


def test_half_the_slope_is_that_of_the_weighed_squares() -> None:
    rows = rows_of(5, 1, 3, 2)

    def squares(change: np.ndarray) -> float:
        moved = rows.residual[0] + rows.by[0] @ change
        return float((rows.precision[0] * moved**2).sum())

    for i, direction in enumerate(np.eye(2)):
        slope = (squares(1e-4 * direction) - squares(-1e-4 * direction)) / 2e-4
        assert rows.slope[0, i] == pytest.approx(slope / 2)

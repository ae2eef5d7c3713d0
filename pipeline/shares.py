"""How much of each lamp a pixel holds: non-negative least squares in the image, in closed form."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float32]
Doubles = NDArray[np.float64]

_REGULAR = 1e-6  # relative determinant below which lamps are too alike at a pixel to be told apart


def shares(no_flash: Array, predictions: Array) -> Array:
    """Non-negative z that bring Σ_j z_j · predictions_j nearest to the no-flash photograph.

    Every subset of up to three lamps is solved exactly and the best one with z ≥ 0 is taken
    (Lawson and Hanson 1974 shows that the minimum is one of these).

    Parameters
    ----------
    no_flash : (..., 3) linear camera RGB
    predictions : (N, ..., 3), T_j I_flash of each lamp, N = 1, 2 or 3

    Returns
    -------
    (N, ...) float32
    """
    count = len(predictions)
    gram = {
        (i, j): _dot(predictions[i], predictions[j]) for i in range(count) for j in range(i, count)
    }
    seen = [_dot(predictions[j], no_flash) for j in range(count)]
    best = np.zeros((count, *no_flash.shape[:-1]), dtype=np.float32)
    gain = np.zeros(no_flash.shape[:-1])
    for size in range(1, count + 1):
        for subset in combinations(range(count), size):
            solution = _solve(subset, gram, seen)
            # ‖I‖² − ‖I − Pz‖² at the least squares solution
            explained = sum(z * seen[j] for j, z in zip(subset, solution, strict=True))
            better = (explained > gain) & np.logical_and.reduce([z >= 0 for z in solution])
            gain = np.where(better, explained, gain)
            for j in range(count):
                value = solution[subset.index(j)] if j in subset else 0.0
                best[j] = np.where(better, value, best[j])
    return best


def _solve(
    subset: tuple[int, ...], gram: dict[tuple[int, int], Doubles], seen: list[Doubles]
) -> list[Doubles]:
    """Least squares for some of the lamps; −1 where they cannot be told apart."""
    if len(subset) == 1:
        (a,) = subset
        return [_divide(seen[a], gram[a, a], gram[a, a] > 0)]
    if len(subset) == 2:
        a, b = subset
        determinant = gram[a, a] * gram[b, b] - gram[a, b] ** 2
        regular = determinant > _REGULAR * gram[a, a] * gram[b, b]
        return [
            _divide(gram[b, b] * seen[a] - gram[a, b] * seen[b], determinant, regular),
            _divide(gram[a, a] * seen[b] - gram[a, b] * seen[a], determinant, regular),
        ]
    cofactor = {
        (0, 0): gram[1, 1] * gram[2, 2] - gram[1, 2] ** 2,
        (0, 1): gram[0, 2] * gram[1, 2] - gram[0, 1] * gram[2, 2],
        (0, 2): gram[0, 1] * gram[1, 2] - gram[0, 2] * gram[1, 1],
        (1, 1): gram[0, 0] * gram[2, 2] - gram[0, 2] ** 2,
        (1, 2): gram[0, 1] * gram[0, 2] - gram[0, 0] * gram[1, 2],
        (2, 2): gram[0, 0] * gram[1, 1] - gram[0, 1] ** 2,
    }
    determinant = np.stack([gram[0, j] * cofactor[0, j] for j in range(3)]).sum(axis=0)
    regular = determinant > _REGULAR**1.5 * gram[0, 0] * gram[1, 1] * gram[2, 2]
    return [
        _divide(
            np.stack([cofactor[min(i, j), max(i, j)] * seen[j] for j in range(3)]).sum(axis=0),
            determinant,
            regular,
        )
        for i in range(3)
    ]


def _dot(a: Array, b: Array) -> Doubles:
    """Sum over the channels, in double precision: lamps that look alike at a pixel need it."""
    red, green, blue = (np.multiply(a[..., k], b[..., k], dtype=np.float64) for k in range(3))
    return red + green + blue


def _divide(numerator: Doubles, denominator: Doubles, regular: NDArray[np.bool_]) -> Doubles:
    return np.where(regular, numerator / np.where(regular, denominator, 1.0), -1.0)

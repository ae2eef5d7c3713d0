"""The equations of a Gauss–Newton step: sums of small ones, and their solution.

Most unknowns hang together with their neighbours alone, so that their matrix is sparse, with
entries whose places never change. Those that many others hang on are a border about it, solved for
by themselves: they would fill up the factors of the rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse.linalg import LinearOperator, SuperLU, cg, splu

from pipeline.arrays import Floats64

_RIDGE = 1e-9  # of the mean diagonal, so that nothing is singular
_ROUNDS = 64  # of conjugate gradients; as many outer unknowns take no longer at once
_TOLERANCE = 1e-10  # of the slope; at 1e-6 surfaces one before another end elsewhere


@dataclass(frozen=True)
class Rows:
    """Residuals of one kind, r for each of n small groups of k unknowns.

    by: (n, r, k), their derivatives by those. precision: (n, r), how much they count. residual:
    (n, r).
    """

    by: Floats64
    precision: Floats64
    residual: Floats64

    @property
    def weighed(self) -> Floats64:
        """Derivatives (n, k, r) times precision."""
        return np.asarray((self.by * self.precision[..., None]).transpose(0, 2, 1))

    @property
    def slope(self) -> Floats64:
        """Half the slope (n, k) of the sum of weighed squares."""
        return np.asarray((self.weighed @ self.residual[..., None])[..., 0])


class Pattern:
    """Where the entries of a sparse normal matrix are, which rows of several kinds add up to.

    Unknowns are ordered once, so that factors fill up little: every matrix has its entries there.
    """

    def __init__(self, size: int, *groups: NDArray[np.intp]) -> None:
        """size: number of unknowns. groups: (n, k) of each kind, which unknowns its rows are of."""
        self._size, self._groups = size, [group.ravel() for group in groups]
        self._place = _minimum_degree(size, groups)
        self._sums, self._rows, self._starts = _entries(size, [self._place[g] for g in groups])

    def equations(self, *kinds: Rows) -> Equations:
        """Equations of the step that lowers the weighed squares of all rows most."""
        normal = [(rows.weighed @ rows.by).ravel() for rows in kinds]
        values = np.concatenate([*normal, np.zeros(self._size)])
        summed = np.bincount(self._sums, values, len(self._rows))
        diagonal = self._sums[-self._size :]
        summed[diagonal] += _RIDGE * summed[diagonal].mean()
        matrix = sparse.csc_matrix((summed, self._rows, self._starts), (self._size, self._size))
        downhill = np.zeros(self._size)
        for group, rows in zip(self._groups, kinds, strict=True):
            downhill -= np.bincount(group, rows.slope.ravel(), self._size)
        return Equations(matrix, self._place, downhill)


def _entries(
    size: int, groups: Sequence[NDArray[np.intp]]
) -> tuple[NDArray[np.intp], NDArray[np.int32], NDArray[np.int32]]:
    """Which entry each product of two unknowns of a group adds to, and then every diagonal one.

    Returns as well the rows of the entries, column by column, and where columns start.
    """
    rows = [np.broadcast_to(g[:, :, None], (*g.shape, g.shape[1])).ravel() for g in groups]
    columns = [np.broadcast_to(g[:, None, :], (*g.shape, g.shape[1])).ravel() for g in groups]
    every = np.arange(size)
    keys = np.concatenate([*columns, every]) * size + np.concatenate([*rows, every])
    keys, sums = np.unique(keys, return_inverse=True)
    starts = np.searchsorted(keys, np.arange(size + 1) * size)
    return sums, (keys % size).astype(np.int32), starts.astype(np.int32)


def _minimum_degree(size: int, groups: Sequence[NDArray[np.intp]]) -> NDArray[np.intp]:
    """Place (size,) of each unknown in the order in which factors fill up little."""
    _, rows, starts = _entries(size, groups)
    columns = np.repeat(np.arange(size), np.diff(starts))
    values = np.where(rows == columns, float(size), -1.0)  # any will do that can be factored
    matrix = sparse.csc_matrix((values, rows, starts), (size, size))
    return np.asarray(_factored(matrix, permc_spec="MMD_AT_PLUS_A").perm_c, np.intp)


def _factored(matrix: sparse.csc_matrix, **how: Any) -> SuperLU:
    """Factors of a symmetric, positive matrix."""
    return splu(matrix, diag_pivot_thresh=0.0, options={"SymmetricMode": True}, **how)


class Equations:
    """A symmetric, positive sparse system, factored."""

    def __init__(self, matrix: sparse.csc_matrix, place: NDArray[np.intp], right: Floats64) -> None:
        """matrix: (size, size), whose unknowns are at these places (size,). right: (size,)."""
        # narrow panels and no relaxed supernodes: half the time of SuperLU's defaults here
        self._factors = _factored(matrix, permc_spec="NATURAL", panel_size=4, relax=1)
        self._place, self._unknowns, self._right = place, np.argsort(place), right

    def solution(self) -> Floats64:
        """Step (size,)."""
        return self._solved(self._right)

    def _solved(self, right: Floats64) -> Floats64:
        return np.asarray(self._factors.solve(right[self._unknowns])[self._place])

    def solution_with(
        self, border: Floats64, corner: Floats64, right: Floats64
    ) -> tuple[Floats64, Floats64]:
        """Step (size,), and that (k,) of k more unknowns that many hang on.

        border: (size, k) and corner: (k, k) of the normal matrix. right: (k,), downhill. The outer
        ones by the Schur complement: many of them by conjugate gradients preconditioned by the
        corner (Saad, Iterative Methods for Sparse Linear Systems, 2003, ch. 9 and 14); few, and
        those that would take many rounds, at once. Raises numpy.linalg.LinAlgError where the corner
        is not positive definite.
        """
        about = sparse.csc_array(border)
        downhill = right - about.T @ self.solution()
        outer = self._followed(about, corner, downhill) if len(right) > _ROUNDS else None
        if outer is None:
            complement = corner - about.T @ self._solved(border)
            outer = cho_solve(cho_factor(complement), downhill)
        return self._solved(self._right - about @ outer), np.asarray(outer)

    def _followed(
        self, border: sparse.csc_array, corner: Floats64, downhill: Floats64
    ) -> Floats64 | None:
        """Outer unknowns (k,) by conjugate gradients, None where they take too many rounds."""
        by_corner = cho_factor(corner)

        def complement(outer: Floats64) -> Floats64:
            return np.asarray(corner @ outer - border.T @ self._solved(border @ outer))

        outer, unfinished = cg(
            LinearOperator(corner.shape, complement, dtype=corner.dtype),
            downhill,
            rtol=_TOLERANCE,
            maxiter=_ROUNDS,
            M=LinearOperator(corner.shape, partial(cho_solve, by_corner), dtype=corner.dtype),
        )
        return None if unfinished else np.asarray(outer)

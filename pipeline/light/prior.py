"""What a lamp's matrix may be, learnt from measured lamps and reflectances."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Floats64

_MIN_DEVIATION = 0.02  # of matrices of unit norm
_NORM_WEIGHT = 50.0  # holds |θ| near 1, of which chromaticities tell nothing
_NARROWED = 0.25  # wide priors let noise and clumps of pixels bend the matrices


@dataclass(frozen=True)
class MatrixPrior:
    """Coordinates of lamp matrices: vec T = basis @ θ.

    basis: (9, 9) orthonormal; its first three columns span the model's tensor, the others are
    the principal directions in which measured lamps leave it. deviations: (6,) standard
    deviations of unit-norm matrices along those.
    """

    basis: Floats64
    deviations: Floats64

    def coordinates(self, matrices: Floats64) -> Floats64:
        """θ (N, 9) of matrices (N, 3, 3), scaled to length one."""
        theta = matrices.reshape(-1, 9) @ self.basis
        return np.asarray(theta / np.linalg.norm(theta, axis=1, keepdims=True))

    def matrices(self, theta: Floats64) -> Floats64:
        """Matrices (N, 3, 3) of θ (N, 9)."""
        return (theta @ self.basis.T).reshape(-1, 3, 3)

    def penalty(self, theta: Floats64) -> tuple[float, Floats64]:
        """½ Σ (c/sd)² + 50 (|θ|² − 1)² over the lamps, and its gradient (N, 9)."""
        outside = theta[:, 3:] / self.deviations
        excess = (theta**2).sum(axis=1) - 1.0
        value = 0.5 * (outside**2).sum() + _NORM_WEIGHT * (excess**2).sum()
        gradient = 4 * _NORM_WEIGHT * excess[:, None] * theta
        gradient[:, 3:] += outside / self.deviations
        return float(value), gradient


def learn_prior(tensor: Floats64, lamp_matrices: Floats64) -> MatrixPrior:
    """Learn the prior from the tensor (3, 3, 3) and the matrices (m, 3, 3) of measured lamps."""
    vectors = lamp_matrices.reshape(-1, 9)
    vectors = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    inside, _ = np.linalg.qr(tensor.transpose(2, 0, 1).reshape(3, 9).T)
    residuals = vectors - vectors @ inside @ inside.T
    # the residuals span the six dimensions that are left; rounding must not tip them back
    complement = np.linalg.svd(np.eye(9) - inside @ inside.T)[0][:, :6]
    directions = complement @ np.linalg.svd(residuals @ complement)[2].T
    deviations = np.sqrt(((residuals @ directions) ** 2).mean(axis=0))
    return MatrixPrior(
        np.concatenate([inside, directions], axis=1),
        _NARROWED * np.maximum(deviations, _MIN_DEVIATION),
    )

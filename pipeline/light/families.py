"""To which family of lamps a fitted matrix belongs, with a probability."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Floats64
from pipeline.images.frames import Matrix
from pipeline.light.prior import MatrixPrior
from pipeline.spectra.families import FAMILIES
from pipeline.vectors import unit

# Chosen on development scenes (docs/decisions/0008-known-lamps.md)
_SPREAD, _APPROXIMATE_SPREAD = 0.05, 0.2  # of directions of length one
_KEPT = 0.5  # of what lies outside the model's space: the fit's prior is narrow


@dataclass(frozen=True)
class FamilyBank:
    """Measured lamps by family, as the places (n, 9) where the fit would find each.

    A place is the colour of a white card and the six coordinates outside the model's space.
    spread: standard deviation of fits about them, and of lamps about the measured ones.
    """

    prior: MatrixPrior
    flash_white: Floats64
    places: Mapping[str, Floats64]
    spread: float

    def probabilities(self, matrix: Matrix) -> dict[str, float]:
        """Probability of each of FAMILIES for a fitted matrix (3, 3) of any scale and sign.

        Bayes' rule, the density of a family the mean of normal kernels about its measured lamps
        (Parzen 1962).
        """
        (place,) = _places(matrix[None], self.prior, self.flash_white)
        log = {
            family: np.log(FAMILIES[family])
            - np.log(len(known))
            + np.logaddexp.reduce(-(((known - place) / self.spread) ** 2).sum(axis=1) / 2)
            for family, known in self.places.items()
        }
        whole = np.logaddexp.reduce(list(log.values()))
        return {family: float(np.exp(value - whole)) for family, value in log.items()}

    def nearest(self, matrix: Matrix) -> tuple[str, float]:
        """The likeliest of FAMILIES, and how likely it is, for a fitted matrix (3, 3)."""
        return max(self.probabilities(matrix).items(), key=lambda item: item[1])


def learn_families(
    prior: MatrixPrior,
    lamp_matrices: Mapping[str, Matrix],
    flash_white: Floats64,
    approximate: bool,
) -> FamilyBank:
    """Learn the families from the matrices (n, 3, 3) of the measured lamps of each.

    flash_white: (3,) camera RGB of a white card under the flash. approximate: whether the camera's
    sensitivities are not its own, and lamps are told less well.
    """
    scale = np.array([1.0, 1.0, 1.0] + 6 * [_KEPT])
    places = {
        family: _places(matrices, prior, flash_white) * scale
        for family, matrices in lamp_matrices.items()
    }
    spread = _APPROXIMATE_SPREAD if approximate else _SPREAD
    return FamilyBank(prior, flash_white, places, spread)


def _places(matrices: Matrix, prior: MatrixPrior, flash_white: Floats64) -> Floats64:
    whites = matrices @ flash_white
    sign = np.sign(whites.sum(axis=1))[:, None]  # chromaticities do not tell T from −T
    outside = prior.coordinates(matrices)[:, 3:]
    return np.concatenate([sign * unit(whites), sign * outside], axis=1)

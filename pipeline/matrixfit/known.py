"""Lamps that are given before the fit: pinned ones among those found, forbidden ones not."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats64
from pipeline.matrixfit.objective import Term
from pipeline.vectors import unit

FORBIDDEN_DEGREES = 3.0
"""No free lamp is as near as this to a forbidden one, in the colour of a white card."""

_FENCE_DEGREES = 3.4  # where the penalty begins: fits come to lie a little inside
_FENCE_HEIGHT = 3000.0  # log likelihood, more than a lamp can gain


@dataclass(frozen=True)
class Pin:
    """A lamp that is held.

    term: what it shows alone. matrix: (3, 3), unit norm, its best fit. of_area: whether an area of
    the photograph shows it, and not a spectrum.
    """

    term: Term
    matrix: Floats64
    of_area: bool


@dataclass(frozen=True)
class Known:
    """What is known of the lamps.

    pinned: the first lamps of every fit. forbidden: (m, 3) unit camera RGB of a white card under
    lights that no free lamp may be near. flash_white: (3,) that card under the flash.
    """

    pinned: tuple[Pin, ...]
    forbidden: Floats64
    flash_white: Floats64

    @property
    def matrices(self) -> Floats64:
        """Matrices (k, 3, 3) of the pinned lamps."""
        return np.array([pin.matrix for pin in self.pinned]).reshape(-1, 3, 3)

    def without(self, left_out: Pin) -> Known:
        """All of it but one of the pinned lamps."""
        return replace(self, pinned=tuple(pin for pin in self.pinned if pin is not left_out))

    def forbids(self, matrices: Floats64) -> NDArray[np.bool_]:
        """Whether each of some lamps (n, 3, 3) comes near a forbidden one."""
        cosines = unit(matrices @ self.flash_white) @ self.forbidden.T
        # chromaticities do not tell T from −T
        return np.asarray((np.abs(cosines) > np.cos(np.radians(FORBIDDEN_DEGREES))).any(axis=1))

    def rejects(self, matrices: Floats64) -> bool:
        """Whether a free lamp of a fit (N, 3, 3) comes near a forbidden one."""
        return bool(self.forbids(matrices[len(self.pinned) :]).any())

    def fence(self, matrices: Floats64) -> tuple[float, Floats64]:
        """Penalty that keeps free lamps (N, 3, 3) off forbidden ones, and its gradient."""
        value, gradient = 0.0, np.zeros_like(matrices)
        if not len(self.forbidden):
            return value, gradient
        limit = np.cos(np.radians(_FENCE_DEGREES))
        for lamp in range(len(self.pinned), len(matrices)):
            white = matrices[lamp] @ self.flash_white
            length = np.linalg.norm(white)
            cosines = self.forbidden @ white / length
            depth = np.maximum(np.abs(cosines) - limit, 0.0) / (1.0 - limit)
            value += _FENCE_HEIGHT * float((depth**2).sum())
            slope = 2 * _FENCE_HEIGHT * depth * np.sign(cosines) / (1.0 - limit)
            by_white = (slope @ self.forbidden - slope @ cosines * white / length) / length
            gradient[lamp] = np.outer(by_white, self.flash_white)
        return value, gradient

    def completed(self, matrices: Floats64) -> Floats64:
        """Lamps (N, 3, 3) of which each pinned one has taken the place of the nearest."""
        rest = list(matrices)
        for pin in self.pinned:
            likeness = [abs(float((one * pin.matrix).sum())) for one in rest]
            rest.pop(int(np.argmax(likeness)))
        return np.concatenate([self.matrices, np.array(rest).reshape(-1, 3, 3)])


def nothing_known(flash_white: Floats64) -> Known:
    """No pinned lamp, and no forbidden one. flash_white: (3,), as in Model."""
    return Known((), np.zeros((0, 3)), flash_white)

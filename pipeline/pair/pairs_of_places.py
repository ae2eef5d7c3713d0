"""Pairs of places of one surface, and how far what lamps gave more keeps the flash from one colour.

What the flash photograph has more than the other is the flash's light, which on one surface has one
colour, and what lamps gave more by then, which has another wherever more of it falls. So changes of
the lamps are those without which most pairs of neighbouring places have flash parts of one colour.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Floats64
from pipeline.images.frames import Mask

# Chosen on development scenes (docs/trials/lamps_that_change.md)
WIDTHS = (0.1, 0.06, 0.04, 0.025, 0.015)
"""Natural logarithms of colour, of bells one by one: the first holds all pairs of one surface."""

_STEPS = 5  # with each bell
_RIDGE = 1e-3  # of all curvature
_PEAK = (0.03, 0.08)  # the same: a bell less a wide one of the same volume, as of one_surface
_LEAST_PART = 0.05  # of a flash part that may be left without a change


@dataclass(frozen=True)
class Places:
    """Pairs of places in which the lamps' share differs.

    flash: (2, n, 3), what the flash photograph has more in either. light: (N, 2, n, 3), what it may
    have more or less of, so many times as much: each lamp's light, or that times a wave.
    """

    flash: Floats64
    light: Floats64

    def without(self, changes: Floats64) -> tuple[Floats64, Mask]:
        """The flash parts (2, n, 3) > 0 without changes (N,) of the light, and where it is real."""
        left = self.flash - np.tensordot(changes, self.light, 1)
        least = _LEAST_PART * self.flash
        return np.maximum(left, least), np.asarray((left > least).all(axis=(0, 2)))

    def height(self, changes: Floats64) -> float:
        """Of the peak of flash parts that have one colour in both places, % of the pairs."""
        return self._height(changes, 0.0)

    def gain(self, changes: Floats64, before: Floats64) -> float:
        """By how much the peak is higher without changes (N,) than without those before, as height.

        Light that is put back to the flash parts makes any colours more alike, and light that is
        taken off less. So colours are held against each other as they are, and as far apart as
        they would be in all of the flash part; the lesser gain counts.
        """
        return min(
            self._height(changes, whole) - self._height(before, whole) for whole in (0.0, 1.0)
        )

    def _height(self, changes: Floats64, whole: float) -> float:
        """Height of the peak; whole: power of parts ÷ flash that colours are apart by, too."""
        parts, real = self.without(changes)
        left = np.exp(whole * np.log(parts / self.flash).mean(axis=(0, 2)))
        apart = np.square(left[:, None] * _apart(parts)).sum(axis=1)
        narrow, wide = _PEAK
        bells = np.exp(-0.5 * apart / narrow**2)
        bells -= (narrow / wide) ** 2 * np.exp(-0.5 * apart / wide**2)
        return float(100 * np.mean(real * bells))

    def fit(
        self,
        free: Sequence[int],
        changes: Floats64,
        most: float | Floats64,
        widths: Sequence[float] = WIDTHS,
        steps: int = _STEPS,
    ) -> Floats64:
        """Changes (N,) without which ever narrower bells hold most pairs.

        free: which may differ from changes (N,), where the search begins. most: that any may be,
        up or down, one or (N,).
        """
        changes, free = changes.copy(), [*free]
        for width in np.repeat(widths, steps):
            parts, real = self.without(changes)
            apart = _apart(parts)
            slopes = -_colour(self.light[free] / parts)
            slopes = slopes[:, 0] - slopes[:, 1]
            weights = real * np.exp(-0.5 * np.square(apart).sum(axis=1) / width**2)
            slopes = slopes.reshape(len(free), -1)
            weighed = slopes * np.repeat(weights, 2)
            curvature = weighed @ slopes.T
            curvature += (_RIDGE * np.trace(curvature) + 1e-12) * np.eye(len(free))
            changes[free] -= np.linalg.solve(curvature, weighed @ apart.ravel())
            changes = np.clip(changes, -most, most)
        return changes


def _apart(parts: Floats64) -> Floats64:
    """How far two places' (2, n, 3) colours are apart, (n, 2)."""
    colours = _colour(np.log(parts))
    return np.asarray(colours[0] - colours[1])


def _colour(values: Floats64) -> Floats64:
    """Red and blue less green of (…, 3)."""
    return np.asarray(values[..., [0, 2]] - values[..., [1]])

"""The minimum of a smooth function of a few variables, by a quasi-Newton method.

Source: BFGS as in Nocedal & Wright, "Numerical Optimization", 2006, algorithm 6.1; steps are as
long as the conditions of Wolfe ask for, bracketed as by Lewis & Overton, "Nonsmooth optimization
via quasi-Newton methods", 2013.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Floats64

Function = Callable[[Floats64], tuple[float, Floats64]]
"""Gives a value and its gradient (n,) at a place (n,)."""

_GAIN = 1e-4  # of what the slope promises, that a step must bring at least
_LEFT = 0.9  # of the slope, that it may leave
_TRIALS = 20  # of its length
_FURTHER = 4.0  # times as far the next trial goes where the slope is still steep
_INNER = 0.1  # of the bracket of lengths: so far from its lower end the next trial lies at least
_FLAT = 1e-5  # slopes at a minimum


@dataclass(frozen=True)
class Place:
    """A place (n,), the value there and its gradient (n,)."""

    x: Floats64
    value: float
    gradient: Floats64


def minimum(
    function: Function,
    start: Floats64,
    steps: int,
    precision: float,
    first: float = 1.0,
    inverse: Floats64 | None = None,
) -> tuple[Place, Floats64]:
    """The lowest place to which so many steps lead, or fewer where nothing more is gained.

    precision: relative gain below which a step is the last. first: how far from the start (n,) the
    first trial lies. inverse: inverse of the second derivatives (n, n), which is returned, of an
    earlier search on much the same function.
    """
    here = Place(start, *function(start))
    one, is_known = np.eye(len(start)), inverse is not None
    if inverse is None:
        inverse = first / max(float(np.linalg.norm(here.gradient)), _FLAT) * one
    for _ in range(steps):
        if np.abs(here.gradient).max() < _FLAT:
            break
        there = _lower(function, here, -inverse @ here.gradient)
        if there is None:
            break
        moved, change = there.x - here.x, there.gradient - here.gradient
        gained, here = here.value - there.value, there
        if gained < precision * max(abs(here.value), 1.0):
            break
        bend = float(moved @ change)  # > 0, as the slope has become less steep
        if not is_known:
            inverse, is_known = bend / (change @ change) * one, True
        turned = inverse @ change
        inverse = inverse + (1.0 + change @ turned / bend) / bend * np.outer(moved, moved)
        inverse -= (np.outer(turned, moved) + np.outer(moved, turned)) / bend
    return here, inverse


def _lower(function: Function, here: Place, direction: Floats64) -> Place | None:
    """A lower place in a direction, where it is less steep; None where none is found."""
    slope = float(here.gradient @ direction)
    low, high, length = 0.0, np.inf, 1.0
    for _ in range(_TRIALS):
        x = here.x + length * direction
        there = Place(x, *function(x))
        promised = length * slope
        if not there.value <= here.value + _GAIN * promised:
            high = length
            # where a parabola of the slope here and the value there is lowest
            lowest = 0.5 * length * promised / (here.value + promised - there.value)
            length = max(low + _INNER * (high - low), lowest)
        elif there.gradient @ direction < _LEFT * slope:
            low = length
            length = _FURTHER * low if high == np.inf else 0.5 * (low + high)
        else:
            return there
    return None

"""Climbs to the gains of red and blue by which something is highest."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product

import numpy as np

from pipeline.arrays import Floats64

MOST_GAIN = 0.65
"""Natural logarithm of the gain at which a climb ends, in either direction."""

_WAYS = [np.array(way) for way in product((-1, 0, 1), repeat=2) if any(way)]


def climb_gains(
    height: Callable[[Floats64], float], logs: Floats64, first_step: float, last_step: float
) -> tuple[Floats64, float]:
    """The gains of a peak near a start, and its height, by ever smaller steps.

    height: of natural logarithms (2,) of gains of red and blue. logs: (2,), the start. first_step,
    last_step: of logarithms; steps are halved from the one until they are no more than the other.
    """
    most, step = height(logs), first_step
    while step > last_step:
        around = [np.clip(logs + step * way, -MOST_GAIN, MOST_GAIN) for way in _WAYS]
        heights = [height(one) for one in around]
        best = int(np.argmax(heights))
        if heights[best] > most:
            most, logs = heights[best], around[best]
        else:
            step /= 2
    return logs, most

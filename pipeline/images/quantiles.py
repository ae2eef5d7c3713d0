"""Quantiles without sorting, which takes ten times as long; of weighted values compiled."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats32
from pipeline.compiling import exact, summing

ENOUGH = 100_000
"""Values, spread over a picture, that tell its quantiles."""


def quantile(values: NDArray[Any], share: float) -> float:
    """Value below which a share 0…1 of some finite values lies, as NumPy defines it."""
    place = share * (values.size - 1)
    below = int(place)
    parted = np.partition(values, below, axis=None)
    low, above = float(parted[below]), parted[below + 1 :]
    return low if not above.size else low + (float(above.min()) - low) * (place - below)


@exact
def weighted_quantile(values: Floats32, weights: Floats32, share: float) -> Any:
    """Least of some finite values up to which a share 0…1 of all their weight lies.

    By halving the range until one value is left within it, or no number. For other compiled loops,
    too.
    """
    low, high = values.min(), values.max()
    whole, most = _weight_up_to(values, weights, high)
    needed = np.float32(share) * whole
    weight, least = _weight_up_to(values, weights, low)
    if weight >= needed:
        return low
    half = np.float32(0.5)
    middle = low + half * (high - low)
    while low < middle < high and most - least > 1:
        weight, count = _weight_up_to(values, weights, middle)
        if weight >= needed:
            high, most = middle, count
        else:
            low, least = middle, count
        middle = low + half * (high - low)
    return _sum_between(values, low, high) if most - least == 1 else high


@summing
def _weight_up_to(
    values: Floats32, weights: Floats32, limit: np.float32
) -> tuple[np.float32, np.int32]:
    """Of the values up to a limit, how much they weigh and how many they are."""
    total, count = np.float32(0.0), np.int32(0)
    for i in range(len(values)):
        total += weights[i] if values[i] <= limit else np.float32(0.0)
        count += values[i] <= limit
    return total, count


@summing
def _sum_between(values: Floats32, low: np.float32, high: np.float32) -> np.float32:
    """Of the values above low and up to high."""
    total = np.float32(0.0)
    for i in range(len(values)):
        total += values[i] if low < values[i] <= high else np.float32(0.0)
    return total

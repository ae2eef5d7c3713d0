"""Finds by how much a camera balanced the white of the flash photograph otherwise, from the pair.

The gains are those by which the most pairs of neighbours have flash parts of one colour
(one_surface).
"""

from __future__ import annotations

from functools import partial
from itertools import product

import numpy as np

from pipeline.arrays import Floats64
from pipeline.pair.balance_change import BalanceChange
from pipeline.pair.climb_gains import MOST_GAIN, climb_gains
from pipeline.pair.find_tone_curve import usual_contrasts
from pipeline.pair.one_surface import Neighbours, Seen
from pipeline.pair.tone_curve import NO_CONTRAST, ToneCurve

# Chosen on development rooms (docs/trials/renderings.md)
_ROUGH_PAIRS = 1_500
_WIDTHS = ((0.12, 0.3), (0.06, 0.15), (0.03, 0.08))
_GRID = np.linspace(-0.6, 0.6, 9)  # natural logarithms of gains
_FIRST_STEP, _LAST_STEP = 0.5, 0.003  # in widths of a bell; of logarithms
_FOLLOWED = 2
_SURE, _LEAST_HEIGHT = 2.0, 1.0  # times the height without gains; % of the pairs
_LEAST_GAIN = 0.07
_FAR_HIGHER, _ABOUT_AS_HIGH = 1.3, 0.9  # times the height without a contrast


def find_balance_change(neighbours: Neighbours) -> BalanceChange | None:
    """The gains without which the flash's light has one colour in the most places.

    None where equal balances or a contrast explain nearly as much, or where no more differs than is
    found between photographs of one balance.
    """
    curves = sorted(usual_contrasts(), key=lambda curve: bool(curve.logs.any()))  # none comes first
    logs, height = _best(neighbours, curves)
    if not _LEAST_GAIN < np.abs(logs).max() < MOST_GAIN:
        return None
    alike = max(neighbours.through(curve).height(np.zeros(2), _WIDTHS[-1]) for curve in curves)
    if height < max(_LEAST_HEIGHT, _SURE * alike):
        return None
    return _gains(logs)


def settle_balance_change(
    neighbours: Neighbours, start: BalanceChange, tone: ToneCurve | None
) -> tuple[BalanceChange, ToneCurve | None]:
    """The gains near those found, as light is through a contrast, and the contrast.

    None for the contrast where the flash's light has one colour in more places without it.
    """
    height, logs = _followed(neighbours.through(NO_CONTRAST), start)
    if tone is not None:
        toned, others = _followed(neighbours.through(tone), start)
        if toned > _ABOUT_AS_HIGH * height:
            return _gains(others), tone
    return _gains(logs), None


def _followed(seen: Seen, start: BalanceChange) -> tuple[float, Floats64]:
    logs = _climbed(seen, start.logs)
    return seen.height(logs, _WIDTHS[-1]), logs


def _gains(logs: Floats64) -> BalanceChange:
    return BalanceChange(*(float(gain) for gain in np.exp(logs)))


def _best(neighbours: Neighbours, curves: list[ToneCurve]) -> tuple[Floats64, float]:
    """Logarithms (2,) of the gains of red and blue with the highest peak, and its height.

    curves: the first of them is taken unless through another the peak is far higher. Both results
    are 0 where the peak is highest without gains even before it is followed.
    """
    few = neighbours.some(_ROUGH_PAIRS)
    grid = [np.array(logs) for logs in product(_GRID, _GRID)]
    starts = [
        (seen.height(logs, _WIDTHS[0]), which, place)
        for which, seen in enumerate(few.through(curve) for curve in curves)
        for place, logs in enumerate(grid)
    ]
    starts.sort(reverse=True)
    if not grid[starts[0][2]].any():
        return np.zeros(2), 0.0  # most of all where there is none: saves nearly all
    first = next(start for start in starts if start[1] == 0)
    found = []
    for _, which, place in (first, *starts[:_FOLLOWED]):
        seen = neighbours.through(curves[which])
        logs = _climbed(seen, grid[place])
        found.append((seen.height(logs, _WIDTHS[-1]), logs))
    best = max(found, key=lambda one: one[0])
    height, logs = best if best[0] > _FAR_HIGHER * found[0][0] else found[0]
    return logs, height


def _climbed(seen: Seen, logs: Floats64) -> Floats64:
    """Up the height of the peak in ever smaller steps, through bells ever narrower."""
    for widths in _WIDTHS:
        logs, _ = climb_gains(
            partial(seen.height, widths=widths), logs, _FIRST_STEP * widths[0], _LAST_STEP
        )
    return logs

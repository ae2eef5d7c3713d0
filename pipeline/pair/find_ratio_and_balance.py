"""Finds an exposure ratio and a white balance that both differ in a pair that a camera rendered.

By three gains of the flash photograph instead of one or two, where nobody knows the ratio: those by
which the flash's light has one colour on one surface in the most places (one_surface). Where one
lamp gives most of the light, many ratios do about as well, each with other gains; then balances
that differ little tell which. Where one of ratio and balance explains nearly as much as both, the
other is left as it is.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from itertools import product

import numpy as np

from pipeline.arrays import Floats64
from pipeline.pair.balance_change import BalanceChange
from pipeline.pair.climb_gains import climb_gains
from pipeline.pair.find_tone_curve import usual_contrasts
from pipeline.pair.one_surface import Neighbours, PairBlocks, Seen, Widths, find_neighbours
from pipeline.pair.tone_curve import ToneCurve

# Chosen on development rooms (docs/trials/exposure_ratio.md)
_STEEPEST = 1.0  # S, as for the ratio alone
_PAIRS, _ROUGH_PAIRS = 3_000, 700
_ROUGH, _MIDDLE, _FINE = (0.12, 0.3), (0.06, 0.15), (0.03, 0.08)
_RATIOS = np.arange(0.15, -1.45, -0.15)  # natural logarithms, as all that follow
_GAINS = [np.zeros(2), *(np.array(one) for one in product((-0.36, -0.12, 0.12, 0.36), repeat=2))]
_LEAST_GAIN = 0.07
_LAST_ROUGH_STEP, _LAST_STEP = 0.02, 0.006
_FIRST_STEP, _LAST_RATIO_STEP = 0.075, 0.01
_LESS_GAINS = 3.0  # that a peak counts less by, for the squares of gains
_LESS_CONTRAST = 0.3  # the same, for any contrast
_FOLLOWED = 2
_LEAST_HEIGHT = 2.0  # % of the pairs
_SURE = 1.5  # times the height with nothing taken off, and that of the flash photograph itself
_NEARLY = 0.7  # of the height of both, that one of them alone explains enough by
_SHORTER = -0.06  # cameras expose the flash photograph shorter


def find_ratio_and_balance(
    blocks: PairBlocks, alone: float | None
) -> tuple[float, BalanceChange] | None:
    """Exposure of the flash photograph ÷ that of the other, and what it has more of red and blue.

    The ratio is 1 where equal exposures explain nearly as much. None where a ratio alone does, or
    where both photographs as they are do; where colours tell nothing, and where the flash
    photograph seems to have been exposed longer as well. alone: the ratio found without gains.
    """
    neighbours = find_neighbours(blocks, 1.0)
    if neighbours is None:
        return None
    contrasts = [_Contrast.of(neighbours, curve) for curve in usual_contrasts(_STEEPEST)]
    equal = _best([one.rough(0.0) for one in contrasts])
    peaks = [peak for one in contrasts if (peak := one.rough_peak()) is not None]
    both = _best(peaks).refined() if peaks else equal
    most = max(equal.worth, both.worth)
    nothing, by_ratio = (
        max(one.worth(log, np.zeros(2)) for one in contrasts) for log in (0.0, np.log(alone or 1.0))
    )
    if most < max(_LEAST_HEIGHT, _SURE * nothing) or by_ratio > _NEARLY * most:
        return None
    found = equal if equal.worth > _NEARLY * most else both
    if np.abs(found.gains).max() < _LEAST_GAIN or (found is both and not both.surely_shorter()):
        return None
    return float(np.exp(found.log)), BalanceChange(*(float(gain) for gain in np.exp(found.gains)))


@dataclass(frozen=True)
class _Contrast:
    """What the sensor saw of a few pairs of blocks and of many, through a contrast.

    less: how much a peak through it counts.
    """

    few: Seen
    many: Seen
    less: float

    @classmethod
    def of(cls, neighbours: Neighbours, curve: ToneCurve) -> _Contrast:
        few, many = (neighbours.some(most).through(curve) for most in (_ROUGH_PAIRS, _PAIRS))
        return cls(few, many, float(np.exp(-_LESS_CONTRAST * curve.logs.any())))

    def worth(self, log: float, gains: Floats64) -> float:
        """Of a ratio and gains, as of _Peak."""
        return self.less * _worth(_scaled(self.many, log), gains, _FINE)

    def rough(self, log: float) -> _Peak:
        """The best gains by a ratio, as a few pairs tell."""
        seen = _scaled(self.few, log)
        gains = max(_GAINS, key=lambda one: _worth(seen, one, _ROUGH))
        gains, worth = _climbed(seen, gains, _MIDDLE, _LAST_ROUGH_STEP)
        return _Peak(self, log, gains, self.less * worth)

    def rough_peak(self) -> _Peak | None:
        """The best ratio as a few pairs tell, None at the lowest, where light hardly counts."""
        peaks = [self.rough(float(log)) for log in _RATIOS]
        best = max(peaks, key=lambda peak: peak.worth)
        return None if best is peaks[-1] else best

    def fine(self, log: float, gains: Floats64) -> _Peak:
        """The best gains by a ratio, from gains nearby."""
        gains, worth = _climbed(_scaled(self.many, log), gains, _FINE, _LAST_STEP)
        return _Peak(self, log, gains, self.less * worth)


@dataclass(frozen=True)
class _Peak:
    """A ratio and gains (2,), natural logarithms, through a contrast.

    worth: height in % of the pairs, less for a contrast and for gains.
    """

    contrast: _Contrast
    log: float
    gains: Floats64
    worth: float

    def fine(self) -> _Peak:
        """The same by many pairs."""
        return self.contrast.fine(self.log, self.gains)

    def surely_shorter(self) -> bool:
        """Whether the ratio is below 1, and no colour of the flash photograph itself."""
        itself = self.contrast.rough(float(_RATIOS[-1])).fine()  # the lamps' light hardly counts
        return self.log < _SHORTER and self.worth > _SURE * itself.worth

    def refined(self) -> _Peak:
        """The ratio nearby by which it is worth most."""
        best, step = self.fine(), _FIRST_STEP
        while step > _LAST_RATIO_STEP:
            around = [
                self.contrast.fine(log, best.gains) for log in (best.log - step, best.log + step)
            ]
            higher = max(around, key=lambda peak: peak.worth)
            if higher.worth > best.worth:
                best = higher
            else:
                step /= 2
        return best


def _best(rough: list[_Peak]) -> _Peak:
    """Of what a few pairs tell, what is worth most by many."""
    rough = sorted(rough, key=lambda peak: peak.worth, reverse=True)[:_FOLLOWED]
    return max((peak.fine() for peak in rough), key=lambda peak: peak.worth)


def _scaled(seen: Seen, log: float) -> Seen:
    return seen.brightened(np.full((2, seen.light.shape[1]), -log))


def _worth(seen: Seen, gains: Floats64, widths: Widths) -> float:
    return seen.height(gains, widths) * float(np.exp(-_LESS_GAINS * np.square(gains).sum()))


def _climbed(seen: Seen, gains: Floats64, widths: Widths, last: float) -> tuple[Floats64, float]:
    """Up what gains are worth."""
    return climb_gains(partial(_worth, seen, widths=widths), gains, 0.5 * widths[0], last)

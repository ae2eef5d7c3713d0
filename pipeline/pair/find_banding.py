"""Finds bands of lamps that flicker with the mains, by the colours of what the flash added.

Sensors that are read out row by row catch each row at another moment of the mains, and each
photograph begins at another. Then every row has an exposure ratio of its own for the lamps, of
which the flash part's colours tell as they do of one for the whole picture (find_exposure_ratio).
Neither surfaces nor the fall-off of light matter, so that less than one wave to the picture is
found as well.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Floats64
from pipeline.pair.banding import WAVES, Banding, series
from pipeline.pair.find_exposure_ratio import LONG_SIDE, OFFSETS, larger_blocks
from pipeline.pair.one_surface import pairs_apart
from pipeline.pair.pairs_of_places import WIDTHS, Places
from pipeline.pair.ratios import Ratios

# Chosen on development scenes (docs/trials/banding.md)
_CYCLES: Floats64 = np.arange(0.5, 16.25, 0.5)  # higher ones are finer than blocks
_FINEST = 0.02  # cycles
_FEW_PAIRS, _ENOUGH_PAIRS = 300, 1500
_STARTS = ((0.15, 0.0), (-0.15, 0.0), (0.0, 0.15), (0.0, -0.15))  # cosine, sine
_COARSE, _STEPS = (0.08, 0.04), 2  # of the search: bells as WIDTHS, and with each
_MOST = np.repeat([0.6, 0.2], 2)  # of the lamps' light, as terms of Banding
_MOST_STEADY, _LEAST_STEADY = 1.0, -0.2  # the same: in all rows, by a wrong ratio of the exposures
_GAIN = 1.5  # times the height without bands
_LEAST_HEIGHT = 1.5  # % of the pairs; of lower peaks noise makes as much


def find_banding(ratios: Ratios, by_columns: bool) -> Banding | None:
    """Bands in which all lamps gave more or less by the flash photograph; None where none show.

    ratios: of a linear pair on one scale, not of a rendered one. by_columns: whether the sensor's
    rows are the picture's columns.
    """
    no_flash, flash, known = larger_blocks(ratios)
    pairs = pairs_apart(no_flash / flash, known, OFFSETS, _FEW_PAIRS)
    if pairs is None:
        return None
    pairs = pairs[:, :: -(-pairs.shape[1] // _ENOUGH_PAIRS)]
    light = no_flash.reshape(-1, 3)[pairs]
    part = flash.reshape(-1, 3)[pairs] - light
    real = (part > 0).all(axis=(0, 2))
    if np.count_nonzero(real) < _FEW_PAIRS:
        return None
    rows = pairs % known.shape[1] if by_columns else pairs // known.shape[1]
    length = known.shape[1] if by_columns else known.shape[0]
    found = _Search(part[:, real], light[:, real], (rows[:, real] + 0.5) / length).found()
    if found is None:
        return None
    cycles, terms = found
    block = -(-max(ratios.usable.shape) // LONG_SIDE) * ratios.block
    return Banding(length * block / cycles, terms, by_columns)


@dataclass(frozen=True)
class _Search:
    """Pairs of places: what the flash added, and the lamps' light, (2, n, 3).

    rows: (2, n), 0…1 of all that are looked at.
    """

    flash: Floats64
    light: Floats64
    rows: Floats64

    def found(self) -> tuple[float, Floats64] | None:
        """Cycles to all rows and terms of Banding, None where too little is gained by them."""
        steady, none = Places(self.flash, self.light[None]), np.zeros(1)
        ratio = np.clip(steady.fit([0], none, _MOST_STEADY), _LEAST_STEADY, None)
        without = max(steady.height(none), steady.height(ratio), _LEAST_HEIGHT)
        roughly = (self._roughly(each) for each in _CYCLES)
        height, cycles, terms = max(roughly, key=lambda found: found[0])
        step = _CYCLES[1] - _CYCLES[0]
        while step > _FINEST:
            step /= 2
            around = cycles - step, cycles, cycles + step
            near = [self._finely(each, terms) for each in around if each >= _CYCLES[0]]
            height, cycles, terms = max(near, key=lambda found: found[0])
        # what ends at the limits of the search is a wrong ratio of the exposures
        within = cycles > _CYCLES[0] and bool((np.abs(terms) < _MOST).all())
        told = within and height > _GAIN * without
        return (float(cycles), terms) if told else None

    def _places(self, cycles: float) -> Places:
        return Places(self.flash, series(cycles * self.rows)[..., None] * self.light)

    def _roughly(self, cycles: float) -> tuple[float, float, Floats64]:
        """Height of the peak without a wave alone, its cycles and terms."""
        places, found = self._places(cycles), []
        for start in _STARTS:
            terms = np.zeros(2 * WAVES)
            terms[:2] = start
            terms = places.fit([0, 1], terms, _MOST, _COARSE, _STEPS)
            found.append((places.height(terms), cycles, terms))
        return max(found, key=lambda each: each[0])

    def _finely(self, cycles: float, terms: Floats64) -> tuple[float, float, Floats64]:
        """The same with all terms, near those of other cycles."""
        places = self._places(cycles)
        terms = places.fit(range(len(terms)), terms, _MOST, WIDTHS[1:], _STEPS)
        return places.height(terms), cycles, terms

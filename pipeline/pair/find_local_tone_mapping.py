"""Finds what local tone mapping gave one photograph of a pair and not the other, from the pair.

The mapping is the one without which the most pairs of neighbours have flash parts of one colour
(one_surface). Cameras' mappings are not known, but most come near light over a power of its
surroundings, smooth ones (Reinhard et al., "Photographic Tone Reproduction for Digital Images",
2002) or such as keep to edges (Durand & Dorsey, "Fast Bilateral Filtering for the Display of
High-Dynamic-Range Images", 2002), here by the guided filter of He, Sun & Tang, "Guided Image
Filtering", 2010. Some bring each photograph's mean to the same brightness, others do not.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from pipeline.arrays import Floats64
from pipeline.pair.balance_change import BalanceChange
from pipeline.pair.find_tone_curve import usual_contrasts
from pipeline.pair.local_tone_mapping import LocalToneMapping
from pipeline.pair.one_surface import Neighbours, PairBlocks
from pipeline.pair.tone_curve import ToneCurve

# Chosen on development rooms (docs/trials/local_tone_mapping.md)
_REACHES = (0.03, 0.1)  # of surroundings, of the longer side
_EDGE = 0.25  # variance of logarithms that is kept as an edge
_STRENGTHS = (0.1, 0.2, 0.3, 0.45, 0.6)  # powers of the surroundings that are shown
_STEEPEST = 1.0  # a steeper S and a strong mapping take the colour out of all things
_PAIRS, _ROUGH_PAIRS = 4_000, 1_500
_WIDTHS = (0.03, 0.08)
_LESS_STRONG, _LESS_CONTRAST = 1.5, 0.2  # natural logarithms of a height, for strength² and any
_SURE, _SURE_BEYOND = 1.4, 1.2  # times the height without a mapping, and that beyond strangers
_SURE_IN_PART = 1.15  # the same in each half of the picture
_LEAST_HEIGHT = 1.5  # % of the pairs
_LOW_RATIOS = (1.5, 2.0, 2.5)  # natural logarithms by which the lamps' light hardly counts
_HIGHER = 2.5  # times the height by these
_DARK = 1e-3


def find_local_tone_mapping(
    blocks: PairBlocks, neighbours: Neighbours, balance: BalanceChange | None = None
) -> LocalToneMapping | None:
    """The mapping without which the flash's light has one colour in the most places.

    None where a contrast alone does about as well, or where the flash photograph itself has one
    colour in nearly as many. neighbours: pairs of those blocks. balance: what the flash photograph
    has more of red and blue.
    """
    gains = np.zeros(2) if balance is None else balance.logs
    kinds = _kinds(blocks)
    best = _best(neighbours.some(_ROUGH_PAIRS), kinds, gains)
    logs = best.strength * kinds[best.kind]
    asked = neighbours.some(_PAIRS)
    if not _heights(asked, best.contrast, logs, gains).surely():
        return None
    halves = _halves(asked, blocks.known.shape[1])
    if not all(_heights(half, best.contrast, logs, gains).in_part() for half in halves):
        return None
    return LocalToneMapping(logs, blocks.side, best.strength / (1.0 + best.strength))


@dataclass(frozen=True)
class _Choice:
    """A mapping of a kind, its strength, and the contrast on top of it."""

    kind: int
    strength: float
    contrast: ToneCurve


def _kinds(blocks: PairBlocks) -> list[Floats64]:
    """What mappings of strength 1 leave to be multiplied, natural logarithms (h, w)."""
    kinds = []
    light = [cv2.cvtColor(one.astype(np.float32), cv2.COLOR_RGB2GRAY) for one in blocks.srgb]
    no_flash, flash = (np.log(np.maximum(one, _DARK)) for one in light)
    for reach in _REACHES:
        blocks_around = reach * max(blocks.known.shape)
        for around in (_smooth, _edge_aware):
            logs = around(flash, blocks_around) - around(no_flash, blocks_around)
            kinds += [logs, logs - logs[blocks.known].mean()]
    return kinds


def _smooth(logs: Floats64, reach: float) -> Floats64:
    """Logarithm of the mean light around, as far as reach in blocks."""
    return np.asarray(np.log(cv2.GaussianBlur(np.exp(logs), (0, 0), reach)), np.float64)


def _edge_aware(logs: Floats64, reach: float) -> Floats64:
    """Mean logarithm around on the same side of edges."""
    side = 2 * max(int(reach), 1) + 1

    def mean(values: Floats64) -> Floats64:
        around = cv2.boxFilter(values, -1, (side, side), borderType=cv2.BORDER_REFLECT)
        return np.asarray(around, np.float64)

    middle = mean(logs)
    variance = np.maximum(mean(np.square(logs)) - np.square(middle), 0.0)
    slope = variance / (variance + _EDGE)
    return mean(slope) * logs + mean(middle - slope * middle)


def _best(neighbours: Neighbours, kinds: list[Floats64], gains: Floats64) -> _Choice:
    """What leaves the highest peak, mild mappings and no contrast preferred."""
    choices, worth = [], []
    for contrast in usual_contrasts(_STEEPEST):
        seen = neighbours.through(contrast)
        less = _LESS_CONTRAST * contrast.logs.any()
        for kind, logs in enumerate(kinds):
            at_pairs = logs.ravel()[neighbours.numbers]
            for strength in _STRENGTHS:
                height = seen.brightened(strength * at_pairs).height(gains, _WIDTHS)
                choices.append(_Choice(kind, strength, contrast))
                worth.append(height * np.exp(-(_LESS_STRONG * strength**2 + less)))
    return choices[int(np.argmax(worth))]


@dataclass(frozen=True)
class _Heights:
    """Of the peak: with a mapping, the highest without one, and the same beyond strangers.

    itself: of the flash photograph's own colour, the lamps' light hardly counting.
    """

    mapped: float
    plain: float
    mapped_beyond: float
    plain_beyond: float
    itself: float

    def surely(self) -> bool:
        """Whether the mapping explains what nothing else does."""
        least = max(_LEAST_HEIGHT, _SURE * self.plain, _HIGHER * self.itself)
        return self.mapped >= least and self.mapped_beyond >= _SURE_BEYOND * self.plain_beyond

    def in_part(self) -> bool:
        """Whether it explains more in a part of the picture, too."""
        return self.mapped >= _SURE_IN_PART * self.plain


def _heights(
    neighbours: Neighbours, contrast: ToneCurve, logs: Floats64, gains: Floats64
) -> _Heights:
    seen = neighbours.through(contrast)
    mapped = seen.brightened(logs.ravel()[neighbours.numbers])
    plain = [neighbours.through(curve) for curve in usual_contrasts(_STEEPEST)]
    even = np.ones(neighbours.numbers.shape)
    low = [seen.brightened(log * even) for log in _LOW_RATIOS]
    return _Heights(
        mapped=mapped.height(gains, _WIDTHS),
        plain=max(one.height(gains, _WIDTHS) for one in plain),
        mapped_beyond=mapped.excess(gains, _WIDTHS),
        plain_beyond=max(one.excess(gains, _WIDTHS) for one in plain),
        itself=max(one.height(gains, _WIDTHS) for one in low),
    )


def _halves(neighbours: Neighbours, width: int) -> list[Neighbours]:
    """Those of the left and right half, and of the upper and lower one."""
    rows, columns = np.divmod(neighbours.numbers[0], width)
    halves = []
    for places in (rows, columns):
        first = places < np.median(places)
        halves += [neighbours.those(first), neighbours.those(~first)]
    return halves

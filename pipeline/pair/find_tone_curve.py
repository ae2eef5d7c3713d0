"""Finds a camera's contrast from the pair itself, by the colour of the flash's light.

The curve is the one through which the most pairs of neighbours have flash parts of one colour
(one_surface). That what is known of colours tells a camera's response is Lin et al.'s idea (2004,
"Radiometric calibration from a single image"); that the flash tells which, and how, is not theirs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np

from pipeline.arrays import Floats64
from pipeline.pair.balance_change import TO_SENSOR, BalanceChange
from pipeline.pair.one_surface import FlashParts, Neighbours, Widths, taken_off
from pipeline.pair.tone_curve import KNOTS, NO_CONTRAST, ToneCurve

_CONTRAST: Floats64 = np.array(
    (0.36, 0.28, 0.07, -0.18, -0.4, -0.52, -0.57, -0.56, -0.51, -0.4, 0.0)
)
"""What cameras' curves have in common: middle tones brighter, highlights flatter."""
_S_CURVE: Floats64 = np.array((0.5, 0.53, 0.43, 0.27, 0.12, 0.0, -0.09, -0.14, -0.14, -0.1, 0.0))
"""Codes moved by .05·sin 2π away from the middle."""
_STARTS = tuple(product((0.0, 0.4, 0.8, 1.2), (-0.5, 0.0, 1.0, 2.0)))

# Chosen on development rooms (docs/trials/tone_curves.md)
_CONTRAST_SPREAD, _S_SPREAD = 0.7, 1.0
_OTHER_SPREAD, _SMOOTH = 0.06, 0.25  # of what is neither, and over what codes it is alike
_PAIRS, _ROUGH_PAIRS = 2_000, 1_500
_FOLLOWED = 3  # starts
_WIDTHS = ((0.06, 0.15), (0.03, 0.08))
_INDEPENDENT = 400.0  # pairs that all together count for: neighbours say the same
_STEPS, _MOST_STEP = 6, 0.2
_PARTS = (1.0, 0.5, 0.25, 0.125)  # of a step, tried by turns until a curve is likelier
_LEAST_GAIN = 0.05  # of a step that another follows
_SURE = 2.5  # logarithm of how much likelier a curve must be than none
_STRANGE = 7.5  # logarithm of how much less likely cameras make a curve than none
_EXPOSURES = np.exp(np.linspace(-1.2, 1.2, 17))  # times what is taken for granted


def usual_contrasts(steepest: float = 2.0) -> list[ToneCurve]:
    """What cameras' contrasts are about, and none: where the search for one starts.

    steepest: the S that one may have, times .05.
    """
    usual = [(contrast, s) for contrast, s in _STARTS if s <= steepest]
    return [ToneCurve(contrast * _CONTRAST + s * _S_CURVE) for contrast, s in usual]


def find_tone_curve(
    neighbours: Neighbours, balance: BalanceChange | None = None, exposures_known: bool = True
) -> ToneCurve | None:
    """The curve through which the flash's light has one colour in the most places.

    None where sRGB's own curve does about as well, or, if the exposures are not known, another
    ratio of them. balance: what the flash photograph has more of red and blue.
    """
    gains = np.zeros(2) if balance is None else balance.logs
    some, few = neighbours.some(_PAIRS), neighbours.some(_ROUGH_PAIRS)
    starts = [(few.through(curve), curve.logs) for curve in usual_contrasts()]
    if not max(starts, key=lambda start: start[0].height(gains, _WIDTHS[0]))[1].any():
        return None  # most of all where sRGB's curve is all that there is: saves nearly all
    starts.sort(key=lambda start: start[0].excess(gains, _WIDTHS[0]), reverse=True)
    posterior = _Posterior(some, gains)
    found = [_followed(posterior, logs) for _, logs in starts[:_FOLLOWED]]
    best = max(found, key=posterior.excess)
    worth = posterior.value(best, _WIDTHS[-1]) - posterior.value(NO_CONTRAST.logs, _WIDTHS[-1])
    curve = ToneCurve(best)
    if worth < _SURE or posterior.strangeness(best) > _STRANGE or not curve.rises:
        return None
    if not exposures_known and _exposures_explain(some, gains, posterior.height(best, _WIDTHS[-1])):
        return None
    return curve


def _exposures_explain(neighbours: Neighbours, gains: Floats64, height: float) -> bool:
    """Whether the peak is as high without a contrast, through another ratio of the exposures."""
    others = (replace(neighbours, ratio=neighbours.ratio * times) for times in _EXPOSURES)
    heights = [one.through(NO_CONTRAST).height(gains, _WIDTHS[-1]) for one in others]
    return max(heights) >= height


def _covariance() -> Floats64:
    """Of the logarithms that make up a curve: contrast, an S, and what is smooth."""
    smooth = np.exp(-0.5 * np.square((KNOTS[:, None] - KNOTS) / _SMOOTH))
    smooth = smooth - smooth[-1:] - smooth[:, -1:] + 1.0  # at white nothing varies
    kinds = _CONTRAST_SPREAD * _CONTRAST, _S_SPREAD * _S_CURVE
    known = sum(np.outer(kind, kind) for kind in kinds)
    return np.asarray(known + _OTHER_SPREAD**2 * smooth + 1e-6 * np.eye(len(KNOTS)))


@dataclass(frozen=True)
class _Posterior:
    """How likely curves are, by pairs of places and by what cameras do.

    A curve is its logarithms (K,), as of ToneCurve. gains: (2,), logarithms of those of red and
    blue in the flash photograph.
    """

    neighbours: Neighbours
    gains: Floats64

    @cached_property
    def prior(self) -> Floats64:
        """Inverse of the covariance of a curve, (K, K)."""
        return np.linalg.inv(_covariance()).astype(np.float64)

    @cached_property
    def knots(self) -> Floats64:
        """By how much each knot of a curve counts for the light of pairs, (4, n, 3, K)."""
        places = self.neighbours.codes[..., None] * (len(KNOTS) - 1) - np.arange(len(KNOTS))
        return np.asarray(np.maximum(1.0 - np.abs(places), 0.0))

    def height(self, logs: Floats64, widths: Widths) -> float:
        """Height of the peak above its surroundings through a curve, in % of the pairs."""
        return self.neighbours.through(ToneCurve(logs)).height(self.gains, widths)

    def value(self, logs: Floats64, widths: Widths) -> float:
        """Logarithm of how likely a curve is, but for a constant."""
        return _INDEPENDENT / 100 * self.height(logs, widths) - self.strangeness(logs)

    def excess(self, logs: Floats64) -> float:
        """The same by how much more pairs of neighbours are alike than strangers."""
        seen = self.neighbours.through(ToneCurve(logs))
        return _INDEPENDENT / 100 * seen.excess(self.gains, _WIDTHS[-1]) - self.strangeness(logs)

    def strangeness(self, logs: Floats64) -> float:
        """Logarithm of how much less likely cameras make a curve than none."""
        return 0.5 * float(logs @ self.prior @ logs)

    def step(self, logs: Floats64, widths: Widths) -> Floats64:
        """A Gauss–Newton step (K,) towards a likelier curve, as far as the narrow bell bends."""
        parts = self.neighbours.through(ToneCurve(logs)).flash_parts(self.gains)
        colours, slopes = _by_green(np.log(parts.light)), self._slopes(logs, parts)
        off, by = colours[0] - colours[1], slopes[0] - slopes[1]
        squares = np.square(off).sum(axis=1)
        weights = parts.weights(widths[0])
        weights *= _INDEPENDENT / max(weights.sum(), 1e-9)
        narrow, wide = (weights * np.exp(-squares / (2 * w**2)) / w**2 for w in widths)
        falls = narrow - (widths[0] / widths[1]) ** 2 * wide
        bend = np.einsum("ncj,n,nck->jk", by, narrow, by, optimize=True) + self.prior
        slope = np.einsum("nck,n,nc->k", by, falls, off, optimize=True) + self.prior @ logs
        return np.clip(np.linalg.solve(bend, -slope), -_MOST_STEP, _MOST_STEP)

    def _slopes(self, logs: Floats64, parts: FlashParts) -> Floats64:
        """How flash parts' colours change by the logarithms of a curve, (2, n, 2, K)."""
        by = self.neighbours.light(ToneCurve(logs))[..., None] * self.knots
        balanced = taken_off(self.gains)[:, None] * TO_SENSOR
        of_parts = np.einsum("cd,pndk->pnck", balanced, by[2:], optimize=True)
        of_parts -= np.einsum("cd,pndk->pnck", TO_SENSOR, by[:2], optimize=True)
        return _by_green(of_parts / parts.light[..., None])


def _followed(posterior: _Posterior, logs: Floats64) -> Floats64:
    """Follow a curve to where it is likeliest."""
    for widths in _WIDTHS:
        value = posterior.value(logs, widths)
        for _ in range(_STEPS):
            step, before = posterior.step(logs, widths), value
            for part in _PARTS:
                value = posterior.value(logs + part * step, widths)
                if value > before:
                    logs = logs + part * step
                    break
            if value < before + _LEAST_GAIN:
                break
    return logs


def _by_green(channels: Floats64) -> Floats64:
    """Red and blue (2, n, 2, …) of channels (2, n, 3, …), less green."""
    return np.asarray(channels[:, :, [0, 2]] - channels[:, :, 1:2])

"""Things that shine themselves, as screens do: their light is none that lamps throw on them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from cv2.typing import MatLike
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.images.frames import Mask
from pipeline.lamps.lamps import FindLamps, Lamps
from pipeline.matrixfit.unexplained import left_over
from pipeline.pair.reduced import ReducedPair
from pipeline.run_warnings import Code, RunWarning

# Chosen on development scenes (docs/trials/things_that_shine.md)
_DIM, _BRIGHT = 0.3, 3.0  # times the median, of the flash part and of the light relative to it
_SPECK, _GAP, _RIM = 3, 9, 3  # blocks across: smaller places do not count, gaps do
_NOTABLE = 0.03  # share of the usable blocks; as many hold what noise leaves of a weak flash
_LEFT, _SURELY_LEFT = 0.05, 0.07  # of the light there: by all lamps, and by those of the rest
_RENDERED = 2.0  # times that much: a camera's rendering bends light


@dataclass(frozen=True)
class WithoutShining:
    """A reduced pair whose usable blocks do not shine themselves, and its lamps.

    shining: (h, w), the blocks that do.
    """

    reduced: ReducedPair
    lamps: Lamps
    shining: Mask


def without_shining(
    reduced: ReducedPair, lamps: Lamps, estimate: FindLamps
) -> WithoutShining | None:
    """Leave out what shines itself, where there is any; lamps: those of the whole pair.

    Dark glass hardly answers the flash, and is as bright as walls all the same. So is a place far
    off that a lamp lights from near, but that is explained by its lamps. What neither all lamps
    explain nor those that estimate finds in the rest shines itself.
    """
    place = _dim_and_bright(reduced)
    much = _RENDERED if reduced.rendered else 1.0
    if not place.any() or _left_over(reduced, place, lamps) <= much * _LEFT:
        return None
    rest = replace(reduced, usable=reduced.usable & ~place)
    try:
        of_rest = estimate(rest, lamps.requested)
    except InputError:  # too little is left, or lamps that were forbidden
        return None
    if _left_over(reduced, place, of_rest) <= much * _SURELY_LEFT:
        return None
    return WithoutShining(rest, of_rest, place)


def shining_warning(share: float) -> RunWarning:
    """Tell of what was left out, and what to do. share: of the picture."""
    message = (
        f"In {share:.1%} of the picture it is bright though the flash hardly shows there, in "
        "colours that the lamps do not explain: a screen or another thing that shines itself. No "
        "lamp was told by it, and its layers are filled in from their surroundings. Switch it off "
        "or cover it; if it is a place far off under lamps of its own, the flash must reach it."
    )
    return RunWarning(Code.SHINES_ITSELF, message, {"share": share})


def _dim_and_bright(reduced: ReducedPair) -> Mask:
    """Places (h, w) that the flash hardly lights, while the lamps do; none if they are too small.

    Dark parts of theirs, as of a picture on a screen, and their rims belong to them.
    """
    use = reduced.usable
    none = np.zeros_like(use)
    if not use.any():
        return none
    light, part = reduced.no_flash.sum(axis=2), reduced.flash.sum(axis=2)
    relative = np.divide(light, part, out=np.zeros_like(light), where=use)
    dim = part < _DIM * np.median(part[use])
    found = (dim & (relative > _BRIGHT * np.median(relative[use]))).astype(np.uint8)
    found = cv2.morphologyEx(found, cv2.MORPH_OPEN, _square(_SPECK))
    if np.count_nonzero(found) <= _NOTABLE * np.count_nonzero(use):
        return none
    found = cv2.morphologyEx(found, cv2.MORPH_CLOSE, _square(_GAP))
    return _filled(cv2.dilate(found, _square(_RIM)))


def _filled(found: MatLike) -> Mask:
    """Each connected place (h, w) as far as its outermost blocks reach: screens have no bays."""
    outlines, _ = cv2.findContours(found, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    place = np.zeros_like(found)
    for outline in outlines:
        cv2.fillConvexPoly(place, cv2.convexHull(outline), 1)
    return np.asarray(place > 0)


def _square(side: int) -> NDArray[np.uint8]:
    return np.ones((side, side), np.uint8)


def _left_over(reduced: ReducedPair, place: Mask, lamps: Lamps) -> float:
    return left_over(replace(reduced, usable=reduced.usable & place), lamps.matrices)

"""The light that an area of a pair shows, with and without the flash."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Floats, Floats64
from pipeline.errors import OptionError, UnusablePairError
from pipeline.images.frames import Mask
from pipeline.pair.pair import Pair

_MOST_UNUSABLE = 0.1  # share of an area
_LEAST_PIXELS = 9  # of an area: fewer hardly tell a mean
_UNLIT = 4.0  # standard deviations


@dataclass(frozen=True)
class LampsAndFlash:
    """Light of a pair's pixels or areas, (…, 3) linear camera RGB: the lamps', and the flash's.

    lamps_variance, flash_variance: (…, 3), of either by noise.
    """

    lamps: Floats64
    flash: Floats64
    lamps_variance: Floats64
    flash_variance: Floats64


def lamps_and_flash(
    pair: Pair,
    no_flash: Floats,
    flash: Floats,
    averaged: float | Floats,
) -> LampsAndFlash:
    """Split values of a pair's photographs into the light of the lamps and that of the flash.

    no_flash, flash: (…, 3) linear camera RGB, as pair.no_flash and pair.flash have it. averaged:
    how many neighbouring pixels each value is the mean of, a number or (…, 1), for the variances.
    """
    lamps, both = np.asarray(no_flash, np.float64), np.asarray(flash, np.float64)
    lamps_variance = pair.no_flash_noise.variance(lamps, averaged)
    flash_variance = pair.flash_noise.variance(both, averaged)
    if pair.flash_only:
        return LampsAndFlash(lamps, both, lamps_variance, flash_variance)
    return LampsAndFlash(lamps, both - lamps, lamps_variance, flash_variance + lamps_variance)


def mean_light(pair: Pair, mask: Mask, what: str) -> LampsAndFlash:
    """Mean light (3,) of an area that shows one surface.

    mask: bool (H, W). what: the area as messages call it. Raises OptionError for an area too
    small, UnusablePairError where it is clipped or the flash does not reach it, or it lacks a
    colour, as deep ones do where they were rendered to sRGB.
    """
    if mask.sum() < _LEAST_PIXELS:
        raise OptionError(
            f"The mark of {what} covers hardly a pixel of the photograph: check its coordinates, "
            "which are pixels of the photograph without the flash."
        )
    if pair.unusable[mask].mean() > _MOST_UNUSABLE:
        raise UnusablePairError(
            f"{what[:1].upper()}{what[1:]} is clipped, or moved between the photographs: expose "
            "shorter, and keep it still."
        )
    open_ = mask & ~pair.unusable
    no_flash, flash = (frame[open_].mean(axis=0) for frame in (pair.no_flash, pair.flash))
    found = lamps_and_flash(pair, no_flash, flash, float(open_.sum()))
    unlit = found.flash <= _UNLIT * np.sqrt(found.flash_variance)
    if unlit.all():
        raise UnusablePairError(
            f"The flash does not reach {what}: bring it nearer or raise its power."
        )
    if unlit.any():
        colours = " and no ".join(np.array(["red", "green", "blue"])[unlit])
        raise UnusablePairError(
            f"{what[:1].upper()}{what[1:]} shows no {colours} in the light of the flash: bring "
            "it nearer or raise its power. JPEGs and other renderings cut off colours that sRGB "
            "does not hold: send RAW files, or mark a grey card."
        )
    return found

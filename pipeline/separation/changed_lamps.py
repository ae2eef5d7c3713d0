"""Lamps that were brighter or dimmer by the time of the flash photograph, as their colours tell.

What the flash photograph has more than the other is the flash's light, and what lamps gave more by
then: mains flicker, a cloud, a lamp that warms up. On one surface the flash's light has one colour,
and with some of a lamp's in it another wherever more of that lamp falls. So the changes are those
without which most pairs of neighbouring places have flash parts of one colour, as the ratio of the
exposures is told (find_exposure_ratio), lamp by lamp.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pipeline.arrays import Floats64
from pipeline.errors import InputError
from pipeline.images.blocks import sums_of_blocks
from pipeline.images.frames import Image
from pipeline.lamps.count import DOUBTFUL
from pipeline.lamps.lamps import FindLamps, Lamps
from pipeline.pair.find_exposure_ratio import LONG_SIDE, OFFSETS
from pipeline.pair.one_surface import pairs_apart
from pipeline.pair.pairs_of_places import WIDTHS, Places
from pipeline.pair.reduced import ReducedPair
from pipeline.result_names import lamp_name
from pipeline.run_warnings import Code, RunWarning
from pipeline.separation.proportions import model_proportions

# Chosen on development scenes (docs/trials/lamps_that_change.md)
_FEW_PAIRS = 300
_LEAST_KNOWN = 0.6  # of the picture; an object before black has too few surfaces
_NEAR = 3  # of WIDTHS, the narrow ones that refine what was found
_GAIN, _LEAST_HEIGHT = 0.06, 0.5  # of the height, by a lamp that changed; % of the pairs
_CHANCE = 0.21  # the same, times the root of the height: how many pairs there are is chance
_MOST = 0.4  # change; greater ones are found where little tells
_NOTABLE = 0.06  # change; less is told of unchanged lamps
_SETTLED, _ROUNDS = 0.01, 4
_SWEEPS = 3  # of lit_by_flash; each errs by the change times as much less


def without_change(
    reduced: ReducedPair, lamps: Lamps, estimate: FindLamps
) -> tuple[ReducedPair, Lamps, RunWarning] | None:
    """Take what lamps gave more off the flash part, and find them again; None where none changed.

    lamps: those of the pair as it is. The lamps returned have `changes`,
    by which lit_by_flash takes the same off any flash part; beside them is what to tell.

    Where a single lamp was counted, two are tried, for a change hides a second one. Nothing is told
    of one that was asked for, whose change is a ratio of the exposures, nor of photographs that a
    camera rendered, whose curve changes colours, too.
    """
    asked = lamps.requested
    if asked == 1 or reduced.rendered or reduced.flash_only:
        return None
    told, highest, best = np.zeros(0), 0.0, None
    lit = reduced
    try:
        lamps = _several(lit, lamps, estimate)
        for _round in range(_ROUNDS):
            again = len(told) == len(lamps)
            places = _places(reduced, lit, lamps)
            changes = None
            if places is not None:
                changes = _refined(places, told) if again else _told(places)
            if places is None or changes is None:
                break
            if again:
                changes = (changes + told) / 2  # lamps by too small a change tell too great a one
                if np.abs(changes - told).max() < _SETTLED:
                    break
            told = changes
            lit = _without(reduced, replace(lamps, changes=told))
            lamps = _several(lit, estimate(lit, asked), estimate)
            height = places.height(told)
            if height > highest and len(lamps) == len(told):
                highest, best = height, replace(lamps, changes=told)
    except InputError:  # nothing is left that tells of lamps, or they were forbidden
        return None
    if best is None or best.changes is None or np.abs(best.changes).max() <= _NOTABLE:
        return None
    warning = _warning(best.changes)
    if best.requested != asked:
        best = replace(best, requested=asked, confidence=DOUBTFUL)
    return _without(reduced, best), best, warning


def _several(reduced: ReducedPair, lamps: Lamps, estimate: FindLamps) -> Lamps:
    """The lamps, or two where one was counted."""
    return lamps if len(lamps) > 1 else estimate(reduced, 2)


def _without(reduced: ReducedPair, lamps: Lamps) -> ReducedPair:
    return replace(reduced, flash=lit_by_flash(reduced.no_flash, reduced.flash, lamps))


def lit_by_flash(no_flash: Image, flash: Image, lamps: Lamps) -> Image:
    """The flash part (h, w, 3) without what lamps gave more.

    no_flash, flash: (h, w, 3) linear camera RGB, flash with it. Each lamp's light is its part of
    the photograph without the flash, which is found by the flash part in turn.
    """
    if lamps.changes is None:
        return flash
    lit = flash
    for _sweep in range(_SWEEPS):
        parts = model_proportions(no_flash, lit, lamps)
        more = sum(
            np.float32(change) * part for change, part in zip(lamps.changes, parts, strict=True)
        )
        lit = np.asarray(flash - more * no_flash, dtype=flash.dtype)
    return lit


def _told(places: Places) -> Floats64 | None:
    """By how much each lamp (N,) was brighter with the flash; None where no change is told.

    One lamp after the other is let change, that first by which most is gained: of a lamp of the
    flash's own colour little tells.
    """
    steady = np.zeros(len(places.light))
    changes, height = steady, places.height(steady)
    free: list[int] = []
    while len(free) < len(steady):
        rest = [lamp for lamp in range(len(steady)) if lamp not in free]
        fits = [places.fit([*free, lamp], steady, _MOST) for lamp in rest]
        gains = [places.gain(fit, changes) * (np.abs(fit).max() < _MOST) for fit in fits]
        best, most = int(np.argmax(gains)), max(gains)
        before = max(height, 0.0)
        if most < max(_GAIN * before, _CHANCE * np.sqrt(before), _LEAST_HEIGHT - before):
            break
        free, changes, height = [*free, rest[best]], fits[best], places.height(fits[best])
    return changes if np.abs(changes).max() > _NOTABLE else None


def _refined(places: Places, told: Floats64) -> Floats64:
    """Changes (N,) near those told of other layers, 0 where they are."""
    return places.fit(np.flatnonzero(told).tolist(), told, _MOST, WIDTHS[-_NEAR:])


def _places(reduced: ReducedPair, lit: ReducedPair, lamps: Lamps) -> Places | None:
    """Pairs of larger blocks; None where there are too few, or too little of the picture tells.

    lit: the pair with a flash part as far as it is known to be the flash's, by which lamps' shares
    are found.
    """
    layers = model_proportions(lit.no_flash, lit.flash, lamps) * reduced.no_flash
    side = -(-max(reduced.usable.shape) // LONG_SIDE)
    usable = reduced.usable[..., None].astype(np.float64)
    count = sums_of_blocks(usable, side)
    flash, *light = (
        sums_of_blocks(each * usable, side) / np.maximum(count, 1.0)
        for each in (reduced.flash, *layers)
    )
    whole = np.sum(light, axis=0)
    known = count[..., 0] >= side**2 / 2
    if known.mean() < _LEAST_KNOWN:
        return None
    flash, whole = (np.where(known[..., None], each, 1.0) for each in (flash, whole))
    pairs = pairs_apart(whole / (whole + flash), known, OFFSETS, _FEW_PAIRS)
    if pairs is None:
        return None
    flash, *light = (each.reshape(-1, 3)[pairs] for each in (flash, *light))
    return Places(flash, np.stack(light))


def _warning(changes: Floats64) -> RunWarning:
    """Tell which lamp changed most, and what came of it. changes: (N,)."""
    lamp = int(np.abs(changes).argmax())
    change = float(changes[lamp])
    how = "brighter" if change > 0 else "weaker"
    message = (
        f"The light of {lamp_name(lamp)} was {abs(change):.0%} {how} in the flash photograph than "
        "in the other. The pair shows it, and it was taken off as far as a pair tells: wait for "
        "steady light, and under lamps on the mains expose for a multiple of 1/100 s (1/120 s "
        "where the mains has 60 Hz)."
    )
    return RunWarning(Code.LIGHT_CHANGED, message, {"lamp": lamp + 1, "change": change})

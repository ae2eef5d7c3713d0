"""Where the photograph speaks against lamps that were pinned or forbidden."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipeline.arrays import Floats64
from pipeline.matrixfit.fit import MOST_LAMPS, Fit, FitInput
from pipeline.matrixfit.known import Pin
from pipeline.matrixfit.unexplained import unexplained
from pipeline.run_warnings import Code, RunWarning
from pipeline.vectors import angles_deg, unit

# Chosen on development scenes (docs/decisions/0008-known-lamps.md)
_WORSE, _UNEXPLAINED = 20.0, 0.5  # log likelihood; of unexplained
_NEAR_DEGREES = 3.0  # between the colours of a spectrum's lamp and of the one found
# log likelihood for each spectrum: where shadows have edges, right ones cost as much only nearer
_MUCH_WORSE, _COSTLY_DEGREES = 120.0, 1.0
_OTHER_LIGHT, _QUANTILE = 0.02, 0.8  # chromaticity, beyond the noise, in a fifth of the area


def contradictions(given: FitInput, found: Fit, free: Fit) -> list[RunWarning]:
    """Warnings, none where all agrees.

    found: the fit with what is known. free: that of as many lamps without it.
    """
    known = given.known
    said = [
        RunWarning(
            Code.PIN_NOT_PURE,
            f"The area of pinned lamp {number} seems to be lit by more than this lamp: choose a "
            "place, best in the shadow of the other lamps, that none of them reaches.",
            {"pin": number},
        )
        for number, (pin, matrix) in enumerate(zip(known.pinned, found.matrices, strict=False), 1)
        if pin.of_area and other_light(pin, matrix) > _OTHER_LIGHT
    ]
    if said:
        return said
    worse = _worse(given, found, free)
    if not known.pinned:
        message = (
            "The photograph looks as if a forbidden lamp were there: without it, the lamps found "
            "explain the light much worse. Check what is forbidden."
        )
        return [RunWarning(Code.FORBIDDEN_LAMP_SHOWS, message)] if worse else []
    only_spectra = not any(pin.of_area for pin in known.pinned)
    cost = (found.cost - free.cost) / len(known.pinned)
    costly = only_spectra and given.evidence.has_edges and cost > _MUCH_WORSE
    off = [
        _angles(pin.matrix, free.matrices, known.flash_white).min()
        # a spectrum is regressed on other surfaces than the scene's, and never fits as well
        - (0.0 if pin.of_area else _COSTLY_DEGREES if costly else _NEAR_DEGREES)
        for pin in known.pinned
    ]
    if not (worse or costly) or max(off) < 0:
        return []
    number = int(np.argmax(off)) + 1
    message = (
        f"The photograph speaks against pinned lamp {number}: with it, the lamps explain the light "
        "much worse than without. Check its area or spectrum, and the number of lamps."
    )
    return [RunWarning(Code.PIN_CONTRADICTED, message, {"pin": number})]


def needless_pins(found: Fit, fewer: Sequence[Fit]) -> list[RunWarning]:
    """Warn of a pinned lamp without which the others are as likely, none where there is none.

    found: the fit of pinned lamps alone. fewer: for each of them the fit of all others. Of several
    the one is named that is missed least. Only where shadows have edges does the likelihood tell.
    """
    gains = [one.cost - found.cost for one in fewer]
    if not gains or min(gains) > 0:
        return []
    number = int(np.argmin(gains)) + 1
    message = (
        f"Nothing in the photograph shows pinned lamp {number}: the other lamps explain the light "
        "as well without it. Leave it out, or check its area or spectrum."
    )
    return [RunWarning(Code.PIN_CONTRADICTED, message, {"pin": number})]


def _worse(given: FitInput, found: Fit, free: Fit) -> bool:
    """Whether a fit explains the photograph notably worse than another.

    With shadow edges, the likelihood of two lamps tells. Without, it falls also where right lamps
    shine nowhere alone, and of three lamps it prefers narrow triangles, right or wrong.
    """
    if found.cost - free.cost < _WORSE:
        return False
    reduced, evidence = given.reduced, given.evidence
    if evidence.has_edges and len(found.matrices) < MOST_LAMPS:
        return True
    more = unexplained(reduced, evidence, found.matrices)
    return more - unexplained(reduced, evidence, free.matrices) > _UNEXPLAINED


def other_light(pin: Pin, matrix: Floats64) -> float:
    """By how much chromaticities shown by a pinned lamp differ from a matrix's, noise left out.

    matrix: (3, 3). Returns a distance of chromaticities, ≥ 0, beyond which only the worst lie.
    """
    data = pin.term.data
    off = data.u - data.corners(matrix[None])[0]
    squared = float(np.quantile((off**2).sum(axis=1), _QUANTILE))
    # that quantile of normal noise in two dimensions
    noise = -np.log(1.0 - _QUANTILE) * float(data.variance.mean())
    return float(np.sqrt(max(squared - noise, 0.0)))


def _angles(matrix: Floats64, others: Floats64, flash_white: Floats64) -> Floats64:
    """Angles (n,) in degrees between the white card of one lamp and of others (n, 3, 3)."""
    cosines = unit(others @ flash_white) @ unit(matrix @ flash_white)
    return angles_deg(np.abs(cosines))

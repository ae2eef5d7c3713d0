"""Pinned and forbidden lamps: from what a user says of them to what the fit takes."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from pipeline.arrays import Floats64
from pipeline.errors import OptionError
from pipeline.images.frames import Mask
from pipeline.light.model import Model
from pipeline.matrixfit.chromaticities import Chromaticities
from pipeline.matrixfit.evidence import evidence_of_area, evidence_of_surfaces
from pipeline.matrixfit.fit import fit_pin
from pipeline.matrixfit.known import FORBIDDEN_DEGREES, Known, Pin
from pipeline.options import Circle, KnownLamp, Options
from pipeline.pair.reduced import ReducedPair
from pipeline.spectra.lights import find_light, reflectance_spectra
from pipeline.vectors import unit

_FEWEST = 5  # blocks of the reduced pair that tell a light
_SAME_DEGREES = 1.0  # between colours of two lamps that cannot be told apart
_LEAST_SEEN = 1e-3  # of what the camera sees of the flash: less is noise of its measurement


def check_places(options: Options, size: tuple[int, int]) -> None:
    """Refuse areas outside of a photograph, (width, height) in pixels, before any work.

    Raises OptionError.
    """
    for kind, lamps in (("pinned", options.pinned_lamps), ("forbidden", options.forbidden_lamps)):
        for number, lamp in enumerate(lamps, start=1):
            if isinstance(lamp, Circle) and not (0 <= lamp.x < size[0] and 0 <= lamp.y < size[1]):
                raise OptionError(
                    f"The area of {kind} lamp {number} has its middle at {lamp.x:g}, {lamp.y:g}, "
                    f"outside of the photograph's {size[0]} × {size[1]} pixels."
                )


def find_known(options: Options, reduced: ReducedPair, model: Model) -> Known:
    """Find what areas and spectra say of lamps.

    Raises OptionError for an area without usable pixels, an unknown name, a spectrum that the
    camera hardly sees, pinned lamps that are one, and a pinned lamp that is forbidden.
    """

    def shown_by(lamp: KnownLamp, what: str) -> Chromaticities:
        if isinstance(lamp, Circle):
            return evidence_of_area(reduced, _inside(lamp, what, reduced))
        light = find_light(lamp, what)
        _check_seen(model, light, what)
        surfaces, sensitivities = reflectance_spectra(), model.camera.sensitivities
        return evidence_of_surfaces(
            *(surfaces @ (sensitivities * power).T for power in (model.flash, light))
        )

    def pins(lamps: Sequence[KnownLamp], kind: str) -> tuple[Pin, ...]:
        return tuple(
            fit_pin(shown_by(lamp, f"{kind} lamp {number}"), model, isinstance(lamp, Circle))
            for number, lamp in enumerate(lamps, start=1)
        )

    forbidden = [pin.matrix for pin in pins(options.forbidden_lamps, "forbidden")]
    whites = unit(np.array(forbidden).reshape(-1, 3, 3) @ model.flash_white)
    known = Known(pins(options.pinned_lamps, "pinned"), whites, model.flash_white)
    _check_unlike(known)
    return known


def _check_seen(model: Model, light: Floats64, what: str) -> None:
    camera = model.camera
    seen, of_flash = ((camera.sensitivities @ power).sum() for power in (light, model.flash))
    if not seen > _LEAST_SEEN * of_flash:
        raise OptionError(
            f"The camera {camera.name!r} sees hardly anything of {what}: check the wavelengths of "
            "both."
        )


def _inside(area: Circle, what: str, reduced: ReducedPair) -> Mask:
    """Blocks (h, w) whose middle lies in the area. Raises OptionError where too few are usable."""
    v, u = np.indices(reduced.usable.shape) + 0.5
    block = reduced.block
    inside = np.hypot(u * block - area.x, v * block - area.y) < area.radius
    if inside.sum() < _FEWEST:
        raise OptionError(
            f"The area of {what} is too small to tell a light: give it a radius of {2 * block} "
            "pixels or more, and leave it inside the photograph."
        )
    if (inside & reduced.usable).sum() < _FEWEST:
        raise OptionError(
            f"The area of {what} is clipped, dark or out of the flash's reach: choose another "
            "place that this lamp lights alone."
        )
    return np.asarray(inside)


def _check_unlike(known: Known) -> None:
    whites = unit(known.matrices @ known.flash_white)
    for (i, one), (j, other) in combinations(enumerate(whites, start=1), 2):
        if one @ other > np.cos(np.radians(_SAME_DEGREES)):
            raise OptionError(
                f"Pinned lamps {i} and {j} have the same colour: pin a lamp only once."
            )
    for number, forbidden in enumerate(known.forbids(known.matrices), start=1):
        if forbidden:
            raise OptionError(
                f"Pinned lamp {number} is less than {FORBIDDEN_DEGREES:g}° in colour from a "
                "forbidden one: a lamp cannot be both."
            )

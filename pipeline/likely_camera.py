"""Whose colours linear files hold that name no camera."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import UnusablePairError
from pipeline.frames import Frame
from pipeline.lamps import MIN_PIXELS
from pipeline.matrixfit.evidence import gather_evidence
from pipeline.matrixfit.fit import MOST_LAMPS, first_fit
from pipeline.matrixfit.known import nothing_known
from pipeline.model import Model
from pipeline.reduced import ReducedPair
from pipeline.spectra.cameras import Camera, balanced_sensor, srgb_stand_in, typical_sensor
from pipeline.spectra.lights import reflectance_spectra

Array = NDArray[np.float64]

_TELLING_LAMPS = 2  # one lamp leaves the outline to chance, and any camera explains it
_PRIOR_WEIGHT = 0.2  # the prior is narrower than measured, for other reasons


def names_no_camera(camera: Camera, frame: Frame) -> bool:
    """Whether nothing but the pixels tells whose colours a frame holds."""
    return frame.encoding == "linear" and camera is srgb_stand_in()


def likely_camera(
    reduced: ReducedPair,
    flash: Array,
    requested: Literal["auto", 1, 2, 3],
    flash_only: bool,
    build: Callable[[Camera], Model],
) -> Camera:
    """Choose what explains a pair best: linear sRGB, or the values of a sensor.

    Converters write either, and hardly ever say which. Lamps are fitted with both, as many as are
    asked for but two at least, or two and three, and the likelier fit tells
    (docs/decisions/0031-whose-colours.md). Of a sensor's values, those as they are and those
    balanced for daylight, the ones are taken that look under the flash as the pair does.

    flash: (W,) its spectrum. build: the model of a camera.
    """
    evidence = gather_evidence(reduced, flash_only)
    lit = reduced.flash[reduced.usable].astype(np.float64)
    lit = lit[(lit > 0).all(axis=1)]
    if len(evidence.pixels) < MIN_PIXELS or not len(lit):
        return srgb_stand_in()
    numbers = (
        [_TELLING_LAMPS, MOST_LAMPS] if requested == "auto" else [max(requested, _TELLING_LAMPS)]
    )

    def cost(camera: Camera) -> float:
        model = build(camera)
        unknown = nothing_known(model.flash_white)
        try:
            fits = [first_fit(reduced, evidence, model, number, unknown) for number in numbers]
        except UnusablePairError:  # the camera is so wrong that it makes no sense of any pixel
            return np.inf
        likeliest = min(fits, key=lambda fit: fit.cost)
        theta = model.prior.coordinates(likeliest.matrices)
        return likeliest.cost + _PRIOR_WEIGHT * model.prior.penalty(theta)[0]

    seen = _log_ratios(lit)
    sensor = min(
        (typical_sensor(), balanced_sensor()),
        key=lambda one: np.linalg.norm(_log_ratios(_under(flash, one)) - seen),
    )
    return min((srgb_stand_in(), sensor), key=cost)


def _under(flash: Array, camera: Camera) -> Array:
    """Colours (n, 3) of measured surfaces under the flash."""
    return np.asarray((reflectance_spectra() * flash) @ camera.sensitivities.T)


def _log_ratios(colours: Array) -> Array:
    """Medians (2,) of ln R/G and ln B/G over positive colours (n, 3)."""
    logs = np.log(colours)
    return np.asarray(np.median(logs[:, ::2] - logs[:, 1:2], axis=0))

"""Lamps found on a sphere: their file, what is said of them, and doubts."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from pipeline.calibration.find_marks import draw_marks, find_sphere
from pipeline.calibration.found import Found
from pipeline.calibration.lamps_estimate import LampsEstimate
from pipeline.calibration.matt_sphere import matt_lamps
from pipeline.calibration.mirror_sphere import mirror_lamps
from pipeline.calibration.options import LampsCalibration
from pipeline.errors import OptionError, UnusablePairError
from pipeline.images.frames import Frame
from pipeline.options import DirectedLight
from pipeline.pair.pair import Pair
from pipeline.photometric_stereo.directions import unit_directions
from pipeline.photometric_stereo.focal import focal_length_px
from pipeline.photometric_stereo.responses import floored
from pipeline.run_warnings import Code, RunWarning
from pipeline.taken_with import TakenWith

_FAR_ASIDE_DEG = 5.0  # of the flash beside the lens, seen from the sphere


def calibrate_lamps(pair: Pair, frame: Frame, options: LampsCalibration) -> Found:
    """Find the directions of lamps, and strengths and colours where it shows them, on a sphere.

    frame: the no-flash photograph, of which size and EXIF count. The sphere is looked for where it
    is not told. Raises MarkError where no sphere is found, OptionError for one that cannot be used,
    UnusablePairError where it cannot be read, and for lamps that fix no normals.
    """
    focal_px, warnings = focal_length_px(frame, options.focal_px)
    sphere = options.sphere or find_sphere(pair, options.mirror, focal_px)
    estimate = mirror_lamps if options.mirror else matt_lamps
    lamps = estimate(pair, sphere, options.lights, focal_px)
    lights = _lights(lamps)
    _check_directions(lights)
    said: dict[str, Any] = {
        "lights": [
            {**light, "deviation_deg": round(float(deviation), 3)}
            for light, deviation in zip(lights, lamps.deviations_deg, strict=True)
        ],
        "sphere": {k: round(v, 2) for k, v in lamps.circle.model_dump().items()},
    }
    if lamps.flash_aside_deg is not None:
        said["flash_aside_deg"] = round(lamps.flash_aside_deg, 2)
    if lamps.misfit is not None:
        said["misfit"] = round(lamps.misfit, 4)
    # each says it, so that lamps of several files may be put together
    saved = [{**light, "taken_with": TakenWith.of(frame).model_dump()} for light in lights]
    file = (json.dumps({"lights": saved}, indent=1) + "\n").encode()
    warnings += _lamp_warnings(lamps, options.setup)
    return Found(file, said, draw_marks(pair, None, lamps.circle), warnings)


def _lights(lamps: LampsEstimate) -> list[dict[str, Any]]:
    """Entries of DirectedLight; strengths and colours only where the sphere shows them."""
    lights: list[dict[str, Any]] = [
        {"direction": [round(float(c), 5) for c in direction]} for direction in lamps.directions
    ]
    if np.isnan(lamps.colours).any():
        return lights
    # a strength is of green, which normals take as no less of a lamp that has none
    colours = floored(lamps.colours)
    strongest = float(colours[:, 1].max())
    for light, colour in zip(lights, colours, strict=True):
        if len(lights) > 1:  # one alone is not as strong as one of another file
            light["strength"] = float(f"{colour[1] / strongest:.5g}")
        light["rgb"] = [round(float(c), 5) for c in colour / colour.max()]
    return lights


def _lamp_warnings(lamps: LampsEstimate, setup: str | None) -> list[RunWarning]:
    """What keeps lamps found on a sphere from good normals. setup: for which they are kept."""
    warnings = []
    aside_deg = lamps.flash_aside_deg
    if aside_deg is not None and aside_deg > _FAR_ASIDE_DEG:
        message = (
            f"The flash shines from {aside_deg:.0f}° beside the camera, where normals "
            "are exact only with a flash at the camera: move it nearer to the lens, or step back."
        )
        figures = {"angle_deg": aside_deg}
        warnings.append(RunWarning(Code.FLASH_ASIDE, message, figures))
    if lamps.one_more:
        message = (
            "One lamp more would explain far more of the light on the sphere, without which the "
            "others' directions may be wrong by many degrees: check the number of lamps that was "
            "told, and keep other light off the sphere."
        )
        warnings.append(RunWarning(Code.UNEXPLAINED, message, {"misfit": lamps.misfit or 0.0}))
    if len(lamps.directions) == 1 and setup is not None:
        message = (
            "One lamp alone fixes no normals, so that what is kept for the set-up "
            f"{setup!r} will be left out: calibrate with all lamps, or put those of "
            "several calibrations together into one file of --light-directions."
        )
        warnings.append(RunWarning(Code.KEPT_UNUSABLE, message))
    if np.isnan(lamps.colours).any():
        message = (
            "A highlight of a lamp is clipped, so that only the lamps' directions are known: "
            "expose shorter for their strengths and colours, and for dimmer lamps beside them."
        )
        warnings.append(RunWarning(Code.HIGHLIGHT_CLIPPED, message))
    return warnings


def _check_directions(lights: list[dict[str, Any]]) -> None:
    """Refuse lamps that no separation could use; of one lamp alone others may come from elsewhere.

    Raises UnusablePairError.
    """
    if len(lights) < 2:
        return
    try:
        unit_directions([DirectedLight.model_validate(light) for light in lights])
    except OptionError as error:
        raise UnusablePairError(
            f"The {len(lights)} lamps found on the sphere are nearly alike, lie nearly in one "
            "plane, or all behind the sphere, which fixes no normals: place them more widely "
            "around the camera."
        ) from error

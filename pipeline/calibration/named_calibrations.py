"""Calibrations that options name outright: they are used, and what does not fit is told."""

from __future__ import annotations

from typing import Any

from pipeline.images.frames import Frame
from pipeline.options import Circle, DirectedLight, PairOptions
from pipeline.run_warnings import Code, RunWarning
from pipeline.spectra.cameras import find_camera
from pipeline.spectra.lights import light_table
from pipeline.taken_with import Kind, TakenWith

_NAMED: dict[str, tuple[Kind, str]] = {
    "camera": ("camera", "The camera that was named was"),
    "flash_spectrum": ("flash", "The flash that was named was"),
    "neutral": ("flash", "The neutral light that was named was"),
    "pinned_lamps": ("flash", "A lamp that was pinned was"),
    "forbidden_lamps": ("flash", "A lamp that was forbidden was"),
    "light_directions": ("lamps", "The light directions that were given were"),
}
"""Options that calibrations may be named in; not `response`, which is of another camera by design.

Of each its kind, for a spectrum is as certain as that of a flash, and how a sentence begins.
"""
_WRONG: dict[Kind, str] = {"camera": "colours", "flash": "colours", "lamps": "normals"}


def named_warnings(options: PairOptions, frame: Frame) -> list[RunWarning]:
    """Warn of calibrations that options name and that were found with other photographs.

    options: of a separation or a calibration. frame: a photograph of the pair. Of what does not
    say what it was found with, nothing is told. Raises OptionError for an unknown camera, and for
    a file of the user's folder that cannot be used.
    """
    here = TakenWith.of(frame)
    warnings = []
    for option, (kind, subject) in _NAMED.items():
        given = getattr(options, option, None)  # not all options have all of them
        values = given if isinstance(given, list) else [given]
        obstacles = [_obstacle(kind, value, frame, here) for value in values if value is not None]
        warnings += [
            RunWarning(
                Code.CALIBRATION_UNFIT,
                f"{subject} found with {obstacle}. Used as asked, that may give wrong "
                f"{_WRONG[kind]}: send photographs like those of the calibration, calibrate with "
                "such as these, or go without.",
            )
            for obstacle in dict.fromkeys(obstacles)
            if obstacle is not None
        ]
    return warnings


def _obstacle(kind: Kind, value: Any, frame: Frame, here: TakenWith) -> str | None:
    taken_with = _taken_with(kind, value, frame)
    if taken_with is None:
        return None
    if kind == "flash":  # light is the same for every camera; kept ones are of the flash on one
        return taken_with.of_pictures(here, kind)
    return taken_with.obstacle(here, kind)


def _taken_with(kind: Kind, value: Any, frame: Frame) -> TakenWith | None:
    if kind == "camera":
        return find_camera(value, frame).taken_with
    if isinstance(value, DirectedLight):
        return value.taken_with
    table = None if isinstance(value, Circle) else light_table(value)
    return None if table is None else table.taken_with

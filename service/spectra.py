"""Refuses options that name a camera or a light that no job would find."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

from pydantic import BaseModel

from pipeline.errors import OptionError
from pipeline.options import Circle
from pipeline.spectra.cameras import named_camera
from pipeline.spectra.folder import names_are_known
from pipeline.spectra.lights import look_up_light
from service.sentences import describe_fault

_CAMERAS = ("camera", "response")
_LIGHTS = {"flash_spectrum": "flash", "neutral": "neutral light"}
_LAMPS = {"pinned_lamps": "pinned lamp", "forbidden_lamps": "forbidden lamp"}
"""Options by name, and what the messages of a job call them."""


def check_spectra(options: BaseModel) -> None:
    """Refuse a camera or a light, by name or as a table, as a job would, and say in which option.

    options: of any kind of job, with what calibrations found filled in. Where the folder of
    LIGHTLAYERS_SPECTRA is on the hosts of workers alone, only the job can tell, and nothing is
    refused. Raises OptionError.
    """
    if not names_are_known():
        return
    for place, look_up in _asked(options):
        try:
            look_up()
        except OptionError as error:
            raise OptionError(describe_fault(place, str(error))) from error


def _asked(options: BaseModel) -> Iterator[tuple[tuple[str | int, ...], Callable[[], object]]]:
    """Places in the options, and what looks up the camera or light there."""
    for name in _CAMERAS:
        if (camera := getattr(options, name, None)) is not None:
            yield (name,), partial(named_camera, camera)
    for name, purpose in _LIGHTS.items():
        if (light := getattr(options, name, None)) is not None:
            yield (name,), partial(look_up_light, light, purpose)
    for name, purpose in _LAMPS.items():
        for index, lamp in enumerate(getattr(options, name, [])):
            if not isinstance(lamp, Circle):
                yield (name, index), partial(look_up_light, lamp, f"{purpose} {index + 1}")

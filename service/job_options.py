"""Reads the options of a job that is done again, and checks them as those of a new one."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel

from pipeline.calibration.options import CALIBRATION_OPTIONS
from pipeline.options import Options
from service.mixing import MixOptions
from service.sentences import in_words
from service.spectra import check_spectra


def check_options(
    task: Literal["separate", "calibrate", "mix"], options: dict[str, Any]
) -> BaseModel:
    """Read options for a kind of job, with what calibrations found filled in. Raises OptionError.

    They may be of a row that an earlier release wrote, when other things were allowed or known.
    """
    with in_words():
        checked = _read(task, options)
    check_spectra(checked)
    return checked


def _read(task: Literal["separate", "calibrate", "mix"], options: dict[str, Any]) -> BaseModel:
    if task == "mix":
        return MixOptions.model_validate(options)
    if task == "calibrate":
        return CALIBRATION_OPTIONS.validate_python(options)
    return Options.model_validate(options)

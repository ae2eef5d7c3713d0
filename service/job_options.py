"""Reads the options of a job that is done again, and checks them as those of a new one."""

from __future__ import annotations

import json
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
        checked = _read(task, json.dumps(options))
    check_spectra(checked)
    return checked


def _read(task: Literal["separate", "calibrate", "mix"], options: str) -> BaseModel:
    if task == "mix":
        return MixOptions.model_validate_json(options, strict=True)
    if task == "calibrate":
        return CALIBRATION_OPTIONS.validate_json(options, strict=True)
    return Options.model_validate_json(options, strict=True)

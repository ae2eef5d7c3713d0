"""What finished calibrations are to the options of other jobs."""

from __future__ import annotations

import json
from typing import Any, TypeVar

from pydantic import BaseModel

from pipeline.calibration.options import FILES
from pipeline.errors import OptionError
from pipeline.spectra.tables import parse_sensitivities, parse_spectrum
from service.api.callers import Caller
from service.api.context import Context
from service.api.models import Calibrated
from service.calibration_names import KINDS, names_calibration
from service.errors import NotReadyError
from service.object_keys import results_key
from service.rows import jobs
from service.rows.states import State
from service.sentences import in_words

_Options = TypeVar("_Options", bound=BaseModel)

_WORDS = {"camera": "a camera", "flash": "a flash", "lamps": "lamps"}


def complete(
    context: Context, caller: Caller, options: _Options, named: dict[str, Any]
) -> _Options:
    """Put what calibrations found where take_out has put stand-ins.

    Raises OptionError and NotReadyError.
    """
    if not named:
        return options
    sent = options.model_dump(mode="json", exclude_unset=True) | named
    with in_words():
        return type(options).model_validate(fill_in(context, caller, sent))


def fill_in(context: Context, caller: Caller, options: Any) -> Any:
    """Put what calibrations found where options name them, so that a job's row is complete.

    options: as sent. Raises OptionError for a calibration that is unknown, of another kind, or
    has ended without success, and NotReadyError for one that has not ended.
    """
    if not isinstance(options, dict):
        return options
    return {
        name: _found(context, caller, name, value["calibration"])
        if names_calibration(name, value)
        else value
        for name, value in options.items()
    }


def _found(context: Context, caller: Caller, option: str, job_id: object) -> Any:
    kind = KINDS[option]
    with context.engine.connect() as connection:
        job = jobs.find(connection, job_id) if isinstance(job_id, str) else None
    if job is None or not caller.may_see(job) or job.task != "calibrate":
        raise OptionError(
            f"{option}: there is no calibration {str(job_id)[:32]!r}; it may have been deleted."
        )
    if job.options["kind"] != kind:
        raise OptionError(
            f"{option}: the calibration is one of {_WORDS[job.options['kind']]}, and this takes "
            f"one of {_WORDS[kind]}."
        )
    if not job.ended:
        raise NotReadyError(
            f"{option}: the calibration is {job.state}; wait until it has succeeded."
        )
    if job.state != State.SUCCEEDED:
        raise OptionError(f"{option}: the calibration is {job.state}; make another.")
    try:
        data = context.storage.get(results_key(job.id, job.attempt, FILES[kind]))
    except FileNotFoundError as error:
        raise OptionError(f"{option}: the calibration is being deleted; make another.") from error
    if kind == "camera":
        return parse_sensitivities(data).model_dump(exclude_unset=True)
    if kind == "flash":
        return parse_spectrum(data).model_dump(exclude_unset=True)
    return json.loads(data)["lights"]


def allow_calibrations(schemas: dict[str, Any]) -> None:
    """Say in the schemas of options that a calibration may stand for a table."""
    for schema in schemas.values():
        for name, field in schema.get("properties", {}).items():
            if name in KINDS and "anyOf" in field:
                field["anyOf"].append({"$ref": f"#/components/schemas/{Calibrated.__name__}"})

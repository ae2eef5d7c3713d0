"""What the process of a task makes of a pair: its separation, a calibration, a mix of its layers.

Imported where such tasks run alone, since it brings all of the pipeline with it.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from pipeline.calibration.calibrate import calibrate_files
from pipeline.calibration.options import CALIBRATION_OPTIONS
from pipeline.errors import OptionError
from pipeline.mixes.mix_files import mix_results
from pipeline.mixes.mix_options import MixRequest
from pipeline.options import Options
from pipeline.process import separate_files
from pipeline.progress import Progress
from service.errors import OlderWorkerError
from service.sentences import in_words
from service.workers import kept_file
from service.workers.tasks import RESULTS, Kind, Task, Tell

Read = TypeVar("Read")


def _separate(task: Task, tell: Tell) -> None:
    separate_files(
        task.photograph("no_flash"),
        task.photograph("flash"),
        _read(Options.model_validate, task.options),
        Path(task.directory) / RESULTS,
        _progress(tell),
        kept=kept_file.read(Path(task.directory)),
    )


def _calibrate(task: Task, tell: Tell) -> None:
    calibrate_files(
        task.photograph("no_flash"),
        task.photograph("flash"),
        _read(CALIBRATION_OPTIONS.validate_python, task.options),
        Path(task.directory) / RESULTS,
        _progress(tell),
    )


def _mix(task: Task, tell: Tell) -> None:
    directory = Path(task.directory)
    request = _read(MixRequest.model_validate, task.options["mix"])
    mix_results(directory, request, directory / RESULTS, _progress(tell))


def _progress(tell: Tell) -> Progress:
    return Progress(lambda stage, fraction: tell({"stage": stage, "fraction": fraction}))


def _read(validate: Callable[[Any], Read], options: Any) -> Read:
    """Read options that the API has found good. Raises OlderWorkerError where we do not."""
    try:
        with in_words():
            return validate(options)
    except OptionError as error:
        raise OlderWorkerError(str(error)) from error


WORK: dict[Kind, Callable[[Task, Tell], None]] = {
    "separate": _separate,
    "calibrate": _calibrate,
    "mix": _mix,
}
"""What does each kind of task; it tells its progress, and raises what service.problems explains."""

"""What is told of a task whose process died with nothing to show, by what it was to do."""

from __future__ import annotations

import signal
from collections.abc import Mapping

from service.errors import (
    AttemptError,
    CrashError,
    FileLimitError,
    KilledError,
    MemoryLimitError,
    NoProcessError,
    OutputLimitError,
    StorageFullError,
    TimeLimitError,
)
from service.workers.exit_codes import DISK_FULL, NO_PROCESS, OUT_OF_FILES, OUT_OF_MEMORY
from service.workers.shortage import TOO_LITTLE_MEMORY
from service.workers.tasks import Kind, Task

DISK_IS_FULL = "The disk on which jobs run is full; send this one again later."

_Sentences = Mapping[type[AttemptError], str]
"""{how}: the signal or exit code of a crash. {seconds}: what the task may take."""

_OPERATOR = "have the operator of the service raise LIGHTLAYERS_JOB"
_KILLED = "The system killed the program, most likely for want of memory"
_DAMAGED = "they are damaged, or of a kind that is not read; if both open elsewhere, report it."
_OVERLOADED = (
    "the machine is overloaded, or they are damaged; send them again, and if only this pair meets "
    "that each time, report it."
)

_OF_HEADERS: _Sentences = {
    CrashError: f"The program that reads the headers of photographs crashed on these: {_DAMAGED}",
    MemoryLimitError: "The headers of these photographs want more memory than a job may have: "
    f"{_DAMAGED}",
    KilledError: "The system killed the program that reads the headers of these photographs: "
    f"{_OVERLOADED}",
    TimeLimitError: "The headers of these photographs were not read within {seconds:g} s: "
    f"{_OVERLOADED}",
    FileLimitError: "The headers of these photographs want more open files than a job may have: "
    f"{_DAMAGED}",
    OutputLimitError: "These photographs are larger than what a job may write; send smaller ones.",
}
_OF_PAIR: _Sentences = {
    CrashError: "The program crashed on these photographs ({how}); if both open elsewhere, report "
    "it with this job's trace_id.",
    MemoryLimitError: TOO_LITTLE_MEMORY,
    KilledError: f"{_KILLED}; send smaller photographs.",
    TimeLimitError: "The job took longer than it may take; send smaller photographs.",
    FileLimitError: f"The job needs more open files than it may have; {_OPERATOR}_OPEN_FILES.",
    OutputLimitError: "The results are larger than a job's may be; ask for fewer, or send smaller "
    "photographs.",
}
_OF_LAYERS: _Sentences = {
    CrashError: "The program crashed on these layers ({how}); report it with this job's trace_id.",
    MemoryLimitError: f"The mix needs more memory than a job may have; {_OPERATOR}_MEMORY_BYTES.",
    KilledError: f"{_KILLED}; mix again when fewer jobs run.",
    TimeLimitError: "The mix took longer than a job may take; mix again when fewer jobs run.",
    FileLimitError: f"The mix needs more open files than a job may have; {_OPERATOR}_OPEN_FILES.",
    OutputLimitError: "The layers and their mix are larger than what a job may write; "
    f"{_OPERATOR}_OUTPUT_BYTES.",
}
_OF_CAPTURE: _Sentences = {
    CrashError: "The program crashed over the camera ({how}); switch that off and on and take the "
    "pair again, and if it crashes anew report it with this job's trace_id.",
    MemoryLimitError: "The photographs need more memory than there is for them; set the camera to "
    "smaller ones and take the pair again.",
    KilledError: f"{_KILLED}; take the pair again.",
    TimeLimitError: "The capture took longer than a job may take; check the camera's connection "
    "and take the pair again.",
    FileLimitError: "The capture needs more open files than a job may have; "
    f"{_OPERATOR}_OPEN_FILES.",
    OutputLimitError: "The photographs are larger than what a job may write; set the camera to "
    "smaller ones and take the pair again.",
}
_OF_CAMERA: _Sentences = {
    CrashError: "The program crashed over the camera ({how}): switch that off and on and try "
    "again, and if it crashes anew report it.",
    MemoryLimitError: "The program that asks the camera needs more memory than a job may have: "
    f"{_OPERATOR}_MEMORY_BYTES.",
    KilledError: f"{_KILLED}: try again when fewer jobs run.",
    TimeLimitError: "The camera gave no answer for {seconds:g} s: switch it off and on and try "
    "again.",
    FileLimitError: "The program that asks the camera needs more open files than a job may have: "
    f"{_OPERATOR}_OPEN_FILES.",
    OutputLimitError: "The program that asks the camera wrote more than a job may: report it.",
}
_SENTENCES: dict[Kind, _Sentences] = {
    "check": _OF_HEADERS,
    "separate": _OF_PAIR,
    "calibrate": _OF_PAIR,
    "mix": _OF_LAYERS,
    "capture": _OF_CAPTURE,
    "cameras": _OF_CAMERA,
    "camera": _OF_CAMERA,
    "camera_settings": _OF_CAMERA,
}
_CODES: dict[int, type[AttemptError]] = {
    OUT_OF_MEMORY: MemoryLimitError,
    OUT_OF_FILES: FileLimitError,
    -signal.SIGXCPU: TimeLimitError,
    -signal.SIGXFSZ: OutputLimitError,
    -signal.SIGKILL: KilledError,
}


def death(task: Task, kind: type[AttemptError], how: str = "") -> AttemptError:
    """Make the error of a task that has died of something; kind: one of those of _SENTENCES."""
    return kind(_SENTENCES[task.kind][kind].format(how=how, seconds=task.limits.seconds))


def check_exit(task: Task, code: int) -> None:
    """Raise what a process has died of, if it has; code: its exit code, negative for a signal.

    Raises CrashError, MemoryLimitError, KilledError, TimeLimitError, FileLimitError,
    OutputLimitError, StorageFullError, NoProcessError.
    """
    if code == 0:
        return
    if code == NO_PROCESS:
        raise NoProcessError
    if code == DISK_FULL:
        raise StorageFullError(DISK_IS_FULL)
    if code in _CODES:
        raise death(task, _CODES[code])
    raise death(task, CrashError, signal.Signals(-code).name if code < 0 else f"exit code {code}")

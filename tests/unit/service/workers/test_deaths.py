from __future__ import annotations

import signal
from typing import get_args

import pytest

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
from service.workers.deaths import check_exit, death
from service.workers.exit_codes import DISK_FULL, NO_PROCESS, OUT_OF_FILES, OUT_OF_MEMORY
from service.workers.tasks import Kind, Limits, Task

DEATHS = (
    CrashError,
    FileLimitError,
    KilledError,
    MemoryLimitError,
    OutputLimitError,
    TimeLimitError,
)


def _task(kind: Kind) -> Task:
    return Task(kind, "7", "1" * 32, "folder", Limits(15.0, 2**30, 10, 64, 2**20), {})


@pytest.mark.parametrize("kind", get_args(Kind))
@pytest.mark.parametrize("error", DEATHS)
def test_there_is_a_sentence_for_each_task_and_death(kind: Kind, error: type[AttemptError]) -> None:
    made = death(_task(kind), error, "SIGSEGV")
    assert type(made) is error
    assert str(made).endswith(".") and "{" not in str(made)


@pytest.mark.parametrize("kind", ["mix", "capture", "cameras", "camera", "camera_settings"])
@pytest.mark.parametrize("error", DEATHS)
def test_nobody_is_asked_to_send_photographs_who_has_sent_none(
    kind: Kind, error: type[AttemptError]
) -> None:
    said = str(death(_task(kind), error, "SIGSEGV"))
    assert "these photographs" not in said and "send" not in said


@pytest.mark.parametrize(
    ("kind", "error", "said"),
    [
        (
            "check",
            TimeLimitError,
            "The headers of these photographs were not read within 15 s: ",
        ),
        ("camera", TimeLimitError, "The camera gave no answer for 15 s: switch it off and on and "),
        ("capture", CrashError, "The program crashed over the camera (SIGSEGV); switch that off "),
        ("separate", CrashError, "The program crashed on these photographs (SIGSEGV); if both "),
        ("mix", CrashError, "The program crashed on these layers (SIGSEGV); report it with "),
    ],
)
def test_what_is_known_of_a_death_is_told(kind: Kind, error: type[AttemptError], said: str) -> None:
    assert str(death(_task(kind), error, "SIGSEGV")).startswith(said)


@pytest.mark.parametrize(
    ("code", "error"),
    [
        (OUT_OF_MEMORY, MemoryLimitError),
        (OUT_OF_FILES, FileLimitError),
        (DISK_FULL, StorageFullError),
        (NO_PROCESS, NoProcessError),
        (-signal.SIGXCPU, TimeLimitError),
        (-signal.SIGXFSZ, OutputLimitError),
        (-signal.SIGKILL, KilledError),
        (-signal.SIGBUS, CrashError),
        (9, CrashError),
    ],
)
def test_an_exit_code_tells_what_a_process_died_of(code: int, error: type[Exception]) -> None:
    with pytest.raises(error) as caught:
        check_exit(_task("separate"), code)
    assert type(caught.value) is error


@pytest.mark.parametrize(
    ("code", "how"), [(-signal.SIGBUS, "SIGBUS"), (9, "exit code 9"), (1, "exit code 1")]
)
def test_a_crash_is_told_with_its_signal_or_code(code: int, how: str) -> None:
    with pytest.raises(CrashError, match=rf"\({how}\)"):
        check_exit(_task("separate"), code)


def test_a_process_that_ended_well_died_of_nothing() -> None:
    check_exit(_task("separate"), 0)

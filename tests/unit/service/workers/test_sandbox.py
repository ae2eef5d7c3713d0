from __future__ import annotations

import contextlib
import json
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import pytest

from service.errors import (
    CrashError,
    FileLimitError,
    KilledError,
    NoProcessError,
    OutputLimitError,
    StorageFullError,
    TimeLimitError,
)
from service.workers import sandbox
from service.workers.forkserver import ForkServer
from service.workers.tasks import Limits, Task
from tests.unit.service.forked import NO_PROCESS_ONCE, fork_server, wait_until_gone

LIMITS = Limits(
    seconds=60, memory_bytes=2**30, cpu_seconds=10, open_files=64, output_bytes=1_000_000
)


def _run(
    code: str, seconds: float = 60, stop: Callable[[], bool] = lambda: False
) -> list[tuple[str, float]]:
    """Run Python code in place of the program that does tasks; what it reported."""
    with contextlib.closing(fork_server(code)) as server:
        return _reports(server, seconds, stop)


def _reports(
    server: ForkServer, seconds: float = 60, stop: Callable[[], bool] = lambda: False
) -> list[tuple[str, float]]:
    task = Task("separate", "7", "trace", "folder", replace(LIMITS, seconds=seconds), {})
    found: list[tuple[str, float]] = []
    sandbox.run(task, lambda *report: found.append(report), stop, server)
    return found


def test_reports_arrive_in_order() -> None:
    said = """
task = json.load(sys.stdin)
for i in range(3):
    print(json.dumps({"stage": task["kind"], "fraction": i / 2}), flush=True)
"""
    assert _run(said) == [("separate", 0.0), ("separate", 0.5), ("separate", 1.0)]


def test_a_report_may_come_in_pieces() -> None:
    said = """
import time
print('{"stage": "la', end="", flush=True)
time.sleep(0.3)
print('yers", "fraction": 1.0}')
"""
    assert _run(said) == [("layers", 1.0)]


def test_a_problem_is_raised() -> None:
    with pytest.raises(sandbox.TaskError, match="too dark") as caught:
        _run("""print('{"problem": {"detail": "too dark", "status": 422}}'); sys.exit(1)""")
    assert caught.value.problem == {"detail": "too dark", "status": 422}


@pytest.mark.parametrize("name", ["SIGSEGV", "SIGABRT", "SIGBUS"])
def test_a_crash_is_told_with_its_signal(name: str) -> None:
    with pytest.raises(CrashError, match=f"crashed on these photographs \\({name}\\)"):
        _run(f"os.kill(os.getpid(), signal.{name})")


def test_a_silent_failure_is_a_crash() -> None:
    with pytest.raises(CrashError, match="exit code 9"):
        _run("sys.exit(9)")


def test_a_kill_from_outside_counts_as_want_of_memory() -> None:
    with pytest.raises(KilledError, match="for want of memory"):
        _run("os.kill(os.getpid(), signal.SIGKILL)")


@pytest.mark.parametrize(
    ("code", "seconds"),
    [
        ("os.kill(os.getpid(), signal.SIGXCPU)", 60.0),
        ("import time; time.sleep(600)", 0.1),
        ("import time; os.close(1); time.sleep(600)", 0.1),
    ],
)
def test_what_takes_too_long_is_ended_and_named(
    code: str, seconds: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sandbox, "_END_SECONDS", 0.1)
    task = Task("capture", "7", "trace", "folder", replace(LIMITS, seconds=seconds), {})
    with (
        contextlib.closing(fork_server(code)) as server,
        pytest.raises(TimeLimitError, match=r"^The capture took longer than a job may take"),
    ):
        sandbox.run(task, lambda _stage, _fraction: None, lambda: False, server)


def test_stopping_kills_the_process_and_what_it_started(tmp_path: Path) -> None:
    code = f"""
import subprocess
child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
open({str(tmp_path / "new")!r}, "w").write(f"{{os.getpid()}} {{child.pid}}")
os.rename({str(tmp_path / "new")!r}, {str(tmp_path / "pids")!r})
time.sleep(600)
"""
    with pytest.raises(sandbox.StoppedError):
        _run(code, stop=(tmp_path / "pids").exists)
    pids = (tmp_path / "pids").read_text().split()
    assert [wait_until_gone(pid) for pid in pids] in (["gone", "gone"], ["gone", "Z"])


def test_a_system_without_processes_is_no_crash() -> None:
    with contextlib.closing(fork_server("sys.exit(0)", NO_PROCESS_ONCE)) as server:
        with pytest.raises(NoProcessError):
            _reports(server)
        assert _reports(server) == []


def test_a_process_that_reads_nothing_is_no_trouble() -> None:
    options: dict[str, Any] = {"camera": "x" * 1_000_000}
    task = Task("separate", "7", "trace", "folder", LIMITS, options)
    with (
        contextlib.closing(fork_server("os._exit(8)")) as server,
        pytest.raises(CrashError, match="exit code 8"),
    ):
        sandbox.run(task, lambda _stage, _fraction: None, lambda: False, server)


@pytest.mark.parametrize(
    ("processors", "at_once", "set_by_operator", "threads"),
    [(5, 1, None, 5), (5, 2, None, 2), (2, 2, None, 1), (2, 9, None, 1), (8, 2, "3", 3)],
)
def test_tasks_at_once_share_the_processors(
    processors: int,
    at_once: int,
    set_by_operator: str | None,
    threads: int,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    code = """
import json, os
from service.workers import forking
forking.serve()
import cv2
print(json.dumps({"stage": os.environ["OMP_NUM_THREADS"], "fraction": cv2.getNumThreads()}))
"""
    monkeypatch.setattr(sandbox, "_COMMAND", (sys.executable, "-c", code))
    monkeypatch.setattr(cv2, "getNumberOfCPUs", lambda: processors)
    for name in ("OMP_NUM_THREADS", "OPENCV_FOR_THREADS_NUM"):
        monkeypatch.delenv(name, raising=False)
        if set_by_operator:
            monkeypatch.setenv(name, set_by_operator)
    with contextlib.closing(sandbox.fork_server(at_once, pairs=True)) as server:
        assert _reports(server) == [(str(threads), threads)]


@pytest.mark.parametrize(("pairs", "arguments"), [(True, ["pairs"]), (False, [])])
def test_the_server_is_told_whether_tasks_take_pairs(
    pairs: bool, arguments: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    code = """
import json, sys
from service.workers import forking
forking.serve()
print(json.dumps({"stage": json.dumps(sys.argv[1:]), "fraction": 1}))
"""
    monkeypatch.setattr(sandbox, "_COMMAND", (sys.executable, "-c", code))
    with contextlib.closing(sandbox.fork_server(1, pairs)) as server:
        assert _reports(server) == [(json.dumps(arguments), 1)]


@pytest.mark.parametrize(
    ("code", "error", "detail"),
    [
        (
            "signal.signal(signal.SIGXFSZ, signal.SIG_DFL); os.kill(os.getpid(), signal.SIGXFSZ)",
            OutputLimitError,
            "larger than a job's may be",
        ),
        ("sys.exit(4)", FileLimitError, "more open files than it may have"),
        ("sys.exit(5)", StorageFullError, "disk on which jobs run is full"),
    ],
)
def test_what_a_process_ran_out_of_is_told(code: str, error: type[Exception], detail: str) -> None:
    with pytest.raises(error, match=detail):
        _run(code)


_FILES = """
task = json.load(sys.stdin)
for number in range({count}):
    with open(os.path.join(task["directory"], str(number)), "wb") as file:
        file.truncate(400_000)
{then}
"""


@pytest.mark.parametrize("then", ["", "import time; time.sleep(600)"])
def test_files_that_are_small_alone_are_too_large_together(tmp_path: Path, then: str) -> None:
    task = Task("separate", "7", "trace", str(tmp_path), LIMITS, {})
    with (
        contextlib.closing(fork_server(_FILES.format(count=3, then=then))) as server,
        pytest.raises(OutputLimitError, match="larger than a job's may be"),
    ):
        sandbox.run(task, lambda _stage, _fraction: None, lambda: False, server)


def test_files_count_that_a_process_writes_once_its_output_is_closed(tmp_path: Path) -> None:
    task = Task("separate", "7", "trace", str(tmp_path), LIMITS, {})
    code = "import time; os.close(1); time.sleep(0.5)" + _FILES.format(count=3, then="")
    with contextlib.closing(fork_server(code)) as server, pytest.raises(OutputLimitError):
        sandbox.run(task, lambda _stage, _fraction: None, lambda: False, server)


def test_files_may_take_up_all_of_the_limit_and_folders_none(tmp_path: Path) -> None:
    task = Task("separate", "7", "trace", str(tmp_path), replace(LIMITS, output_bytes=400_000), {})
    then = 'os.mkdir(os.path.join(task["directory"], "results"))'
    with contextlib.closing(fork_server(_FILES.format(count=1, then=then))) as server:
        sandbox.run(task, lambda _stage, _fraction: None, lambda: False, server)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["0", "results"]


def test_files_within_the_limit_are_let_be(tmp_path: Path) -> None:
    task = Task("separate", "7", "trace", str(tmp_path), LIMITS, {})
    with contextlib.closing(fork_server(_FILES.format(count=2, then=""))) as server:
        sandbox.run(task, lambda _stage, _fraction: None, lambda: False, server)
    assert len(list(tmp_path.iterdir())) == 2


_ASKS = """
task = json.loads(sys.stdin.readline())
answers = []
for kind in ("first", "second"):
    print(json.dumps({"question": {"kind": kind}}), flush=True)
    answers.append(json.loads(sys.stdin.readline()))
print(json.dumps({"answer": answers}), flush=True)
"""


def _ask(code: str, ask: sandbox.Ask) -> Any:
    task = Task("capture", "7", "trace", "folder", LIMITS, {})
    with contextlib.closing(fork_server(code)) as server:
        return sandbox.run(task, lambda *_report: None, lambda: False, server, ask)


def test_questions_are_answered_and_the_answer_comes_back() -> None:
    asked: list[dict[str, Any]] = []

    def ask(question: dict[str, Any], is_dead: Callable[[], bool]) -> bool:
        assert not is_dead()
        asked.append(question)
        return bool(question["kind"] == "second")

    assert _ask(_ASKS, ask) == [False, True]
    assert asked == [{"kind": "first"}, {"kind": "second"}]


def test_what_a_person_takes_to_answer_is_no_time_of_the_task(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    late = 0.0

    class Clock:
        @staticmethod
        def monotonic() -> float:
            return time.monotonic() + late

    monkeypatch.setattr(sandbox, "time", Clock)

    def ask(_question: dict[str, Any], _is_dead: Callable[[], bool]) -> bool:
        nonlocal late
        late += 3600
        return True

    assert _ask(_ASKS, ask) == [True, True]


def test_a_process_ends_when_nobody_is_to_be_asked_any_more() -> None:
    def ask(_question: dict[str, Any], _is_dead: Callable[[], bool]) -> bool:
        raise sandbox.StoppedError

    with pytest.raises(sandbox.StoppedError):
        _ask(_ASKS, ask)


def test_a_process_that_dies_over_its_question_is_not_answered_and_has_crashed() -> None:
    code = """
task = json.loads(sys.stdin.readline())
print(json.dumps({"question": {}}), flush=True)
os._exit(9)
"""

    def until_dead(_question: dict[str, Any], is_dead: Callable[[], bool]) -> bool:
        deadline = time.monotonic() + 60
        while not is_dead():
            assert time.monotonic() < deadline
            time.sleep(0.01)
        return False

    with pytest.raises(CrashError, match="exit code 9"):
        _ask(code, until_dead)

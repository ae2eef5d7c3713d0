from __future__ import annotations

import itertools
import sys
from pathlib import Path
from typing import Any

import pytest

from service import sandbox
from service.errors import CrashError, MemoryLimitError, TimeLimitError


def _run(code: str, seconds: float = 60, stop: bool = False) -> list[tuple[str, float]]:
    """Run Python code in place of the program that does tasks; what it reported."""
    task = sandbox.Task("separate", "7", "trace", "folder", 2**30, 10, {}, None)
    reports: list[tuple[str, float]] = []
    sandbox.run(
        task,
        seconds,
        lambda stage, fraction: reports.append((stage, fraction)),
        lambda: stop,
        [sys.executable, "-c", f"import json, os, signal, sys\n{code}"],
    )
    return reports


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


def test_the_process_learns_who_its_parent_is() -> None:
    assert _run("sys.exit(0 if int(sys.argv[1]) == os.getppid() else 1)") == []


def test_a_problem_is_raised() -> None:
    with pytest.raises(sandbox.TaskError, match="too dark") as caught:
        _run("""print('{"problem": {"detail": "too dark", "status": 422}}'); sys.exit(1)""")
    assert caught.value.problem == {"detail": "too dark", "status": 422}


@pytest.mark.parametrize("name", ["SIGSEGV", "SIGABRT", "SIGBUS"])
def test_a_crash_is_told_with_its_signal(name: str) -> None:
    with pytest.raises(CrashError, match=f"crashed on these photographs \\({name}\\)"):
        _run(f"os.kill(os.getpid(), signal.{name})")


def test_a_silent_failure_is_a_crash() -> None:
    with pytest.raises(CrashError, match="exit code 5"):
        _run("sys.exit(5)")


def test_a_kill_from_outside_counts_as_want_of_memory() -> None:
    with pytest.raises(MemoryLimitError, match="for want of memory"):
        _run("os.kill(os.getpid(), signal.SIGKILL)")


def test_too_much_processor_time_is_too_long() -> None:
    with pytest.raises(TimeLimitError, match="longer than a job may take"):
        _run("os.kill(os.getpid(), signal.SIGXCPU)")


def test_a_process_that_does_not_end_is_ended() -> None:
    with pytest.raises(TimeLimitError):
        _run("import time; time.sleep(600)", seconds=0.1)


def test_a_process_that_only_closes_its_output_is_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sandbox, "_END_SECONDS", 0.1)
    with pytest.raises(TimeLimitError):
        _run("import time; os.close(1); time.sleep(600)", seconds=0.1)


def test_stopping_kills_the_process_and_what_it_started(tmp_path: Path) -> None:
    code = f"""
import subprocess, time
child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
open({str(tmp_path / "new")!r}, "w").write(f"{{os.getpid()}} {{child.pid}}")
os.rename({str(tmp_path / "new")!r}, {str(tmp_path / "pids")!r})
time.sleep(600)
"""
    task = sandbox.Task("separate", "7", "trace", "folder", 2**30, 10, {}, None)
    with pytest.raises(sandbox.StoppedError):
        sandbox.run(
            task,
            60,
            lambda _stage, _fraction: None,
            (tmp_path / "pids").exists,
            [sys.executable, "-c", f"import os, sys\n{code}"],
        )
    pids = (tmp_path / "pids").read_text().split()
    assert [_state(pid) for pid in pids] in (["gone", "gone"], ["gone", "Z"])


def _state(pid: str) -> str:
    # What the child had started may wait for its new parent to notice that it is dead.
    try:
        for _ in itertools.repeat(None):
            state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
            if state in "ZX":
                return "Z"
    except (FileNotFoundError, ProcessLookupError):
        pass
    return "gone"


def test_a_process_that_reads_nothing_is_no_trouble() -> None:
    options: dict[str, Any] = {"camera": "x" * 1_000_000}
    task = sandbox.Task("separate", "7", "trace", "folder", 2**30, 10, options, None)
    with pytest.raises(CrashError, match="exit code 4"):
        sandbox.run(
            task,
            60,
            lambda _stage, _fraction: None,
            lambda: False,
            [sys.executable, "-c", "import os; os._exit(4)"],
        )


def test_results_are_the_files_of_the_folder_by_name(tmp_path: Path) -> None:
    results = tmp_path / "results"
    (results / "folder").mkdir(parents=True)
    for name in ("manifest.json", "lamp1.jpg"):
        (results / name).write_bytes(b"")
    assert [path.name for path in sandbox.results_of(tmp_path)] == ["lamp1.jpg", "manifest.json"]

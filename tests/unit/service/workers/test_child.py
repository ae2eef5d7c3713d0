from __future__ import annotations

import contextlib
import json
import resource
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

import pytest

import drivers
from service.errors import (
    FileLimitError,
    MemoryLimitError,
    OutputLimitError,
    TimeLimitError,
)
from service.workers import sandbox
from service.workers.exit_codes import DISK_FULL, OUT_OF_FILES, OUT_OF_MEMORY
from service.workers.forkserver import ForkServer
from service.workers.tasks import Limits, TakePair, Task
from tests.jpeg_xl import in_jpeg_xl
from tests.unit.service.forked import fork_server

GIB = 2**30
Kind = Literal["check", "separate", "capture"]
Report = tuple[str, float]


@pytest.fixture
def server(child_server: ForkServer) -> ForkServer:
    """The one that the service has."""
    return child_server


def _run(
    server: ForkServer,
    kind: Kind,
    directory: Path,
    memory: int = 8 * GIB,
    cpu_seconds: int = 60,
    open_files: int = 256,
    output_bytes: int = 4 * GIB,
    camera: str | None = None,
) -> list[Report]:
    limits = Limits(100, memory, cpu_seconds, open_files, output_bytes)
    order = TakePair(camera) if camera else None
    task = Task(kind, "7", "f" * 32, str(directory), limits, {}, order)
    reports: list[Report] = []
    sandbox.run(task, lambda *report: reports.append(report), lambda: False, server)
    return reports


def _photographs(directory: Path, no_flash: bytes, flash: bytes) -> None:
    (directory / "no_flash").write_bytes(no_flash)
    (directory / "flash").write_bytes(flash)


def test_a_sound_pair_passes_the_check(
    server: ForkServer, tmp_path: Path, png: Callable[..., bytes]
) -> None:
    _photographs(tmp_path, png(64, 48), png(64, 48, True))
    assert _run(server, "check", tmp_path) == []


def test_dngs_in_jpeg_xl_pass_by_their_headers_and_are_told_where_they_are_damaged(
    server: ForkServer, tmp_path: Path
) -> None:
    with drivers.open_camera("sim://studio?width=96&height=64") as camera:
        pair = drivers.capture_pair(camera)
    before, after = (in_jpeg_xl(shot.best) for shot in (pair.no_flash, pair.flash))
    _photographs(tmp_path, before, after[:-100])
    assert _run(server, "check", tmp_path) == []
    with pytest.raises(sandbox.TaskError) as caught:
        _run(server, "separate", tmp_path)
    assert caught.value.problem["detail"] == (
        "The photograph with the flash is a damaged or incomplete RAW file: send it again."
    )


def test_a_text_file_does_not(
    server: ForkServer, tmp_path: Path, png: Callable[..., bytes]
) -> None:
    _photographs(tmp_path, b"dear diary", png(64, 48))
    with pytest.raises(sandbox.TaskError, match="without the flash") as caught:
        _run(server, "check", tmp_path)
    problem = caught.value.problem
    assert problem["type"] == "urn:lightlayers:problem:unreadable-image"
    assert (problem["status"], problem["trace_id"]) == (422, "f" * 32)


@pytest.mark.parametrize("kind", ["check", "separate"])
def test_want_of_memory_is_told(server: ForkServer, kind: Kind, tmp_path: Path) -> None:
    with (tmp_path / "no_flash").open("wb") as sparse:
        sparse.truncate(2 * GIB)
    (tmp_path / "flash").write_bytes(b"")
    with pytest.raises(MemoryLimitError, match="more memory than"):
        _run(server, kind, tmp_path, memory=1 * GIB)


def test_want_of_processor_time_is_told(
    server: ForkServer,
    tmp_path: Path,
) -> None:
    with pytest.raises(TimeLimitError):
        _run(
            server,
            "capture",
            tmp_path,
            cpu_seconds=1,
            camera="sim://studio?width=3000&height=2000",
        )


def test_a_capture_gives_both_photographs_and_its_progress(
    server: ForkServer, tmp_path: Path
) -> None:
    reports = _run(server, "capture", tmp_path, camera="sim://studio?width=64&height=64&noise=off")
    assert {stage for stage, _ in reports} == {"capture"}
    fractions = [fraction for _, fraction in reports]
    assert fractions == sorted(fractions)
    assert (fractions[0], fractions[-1]) == (0.0, 1.0)
    for frame in ("no_flash", "flash"):
        assert (tmp_path / frame).read_bytes()[:4] in (b"II*\0", b"MM\0*")


@pytest.mark.parametrize(
    ("address", "kind"),
    [
        ("nowhere://studio", "bad-camera-address"),
        ("sim://garden", "camera-not-found"),
        ("sim://studio?width=64&height=64&fault=focus", "camera-failed"),
    ],
)
def test_a_camera_that_fails_is_a_problem(
    server: ForkServer, address: str, kind: str, tmp_path: Path
) -> None:
    with pytest.raises(sandbox.TaskError) as caught:
        _run(server, "capture", tmp_path, camera=address)
    assert caught.value.problem["type"] == f"urn:lightlayers:problem:{kind}"
    assert list(tmp_path.iterdir()) == []


def test_what_a_child_logs_is_json_with_its_job(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    camera = drivers.serve_simulated("sim://studio?width=64&height=64&noise=off", "127.0.0.1", 0)
    order = TakePair(f"ptp+ip://{camera.address}", keep=False)
    limits = Limits(100, 8 * GIB, 60, 256, 4 * GIB)
    task = Task("capture", "7", "f" * 32, str(tmp_path), limits, {}, order)

    def unplug(_question: dict[str, Any], _has_ended: Callable[[], bool]) -> bool:
        camera.close()
        return True

    with (
        contextlib.closing(camera),
        contextlib.closing(sandbox.fork_server(1, pairs=True)) as own,  # its stderr is read here
    ):
        sandbox.run(task, lambda *_report: None, lambda: False, own, unplug)
    lines = [json.loads(line) for line in capfd.readouterr().err.splitlines()]
    told = {(line["level"], line["logger"], line["job"]) for line in lines}
    assert told == {("warning", "service.workers.camera_tasks", "7")}


def _in_a_child(work: str, open_files: int = 64) -> subprocess.CompletedProcess[bytes]:
    """Run a task whose work is this Python code, with `tell` to tell of it."""
    code = f"""
import os, resource, sys
from service.workers import child
def work(task, tell):
    {work}
child._QUICK["check"] = work
sys.exit(child.main())
"""
    limits = Limits(100, GIB, 60, open_files, GIB)
    task = Task("check", "7", "f" * 32, "", limits, {})
    return subprocess.run(
        [sys.executable, "-c", code],
        input=task.to_json().encode(),
        capture_output=True,
        timeout=100,
        check=False,
    )


def test_what_libraries_print_does_not_get_among_the_messages() -> None:
    done = _in_a_child('print("hello"); os.write(1, b"hello"); tell({"stage": "a"})')
    assert (done.returncode, done.stdout) == (0, b'{"stage": "a"}\n')
    assert done.stderr.count(b"hello") == 2


def test_a_crash_leaves_no_photograph_in_a_core_dump() -> None:
    done = _in_a_child('tell({"core": resource.getrlimit(resource.RLIMIT_CORE)})')
    assert json.loads(done.stdout) == {"core": [0, 0]}


def test_a_child_dies_before_the_service_when_the_machine_is_full() -> None:
    done = _in_a_child('tell({"score": open("/proc/self/oom_score_adj").read()})')
    assert json.loads(done.stdout) == {"score": "1000\n"}


@pytest.mark.parametrize("arguments", [["pairs"], []])
def test_what_separates_is_imported_where_pairs_are_taken_alone(arguments: list[str]) -> None:
    """By the server, which ends when the other side of its socket closes."""
    ours, theirs = socket.socketpair()
    with theirs:
        ours.close()
        command = [sys.executable, "-X", "importtime", "-m", "service.workers.child", *arguments]
        done = subprocess.run(
            command, stdin=theirs.fileno(), stderr=subprocess.PIPE, text=True, check=True
        )
    imported = {line.rpartition("|")[2].strip() for line in done.stderr.splitlines()}
    assert "pipeline.pair.pair_checks" in imported
    assert ("pipeline.process" in imported) == bool(arguments)


def test_what_tasks_need_is_imported_without_starting_a_thread() -> None:
    """A lock that another thread held while a child was forked stays locked in the child."""
    threads = "print(len(os.listdir(f'/proc/{os.getppid()}/task')))"
    imports = "from service.workers import child, pair_tasks; child.compiling.prepare()"
    with contextlib.closing(fork_server(threads, imports)) as server:
        child = server.fork()
        assert child.stdout.read() == b"1\n"
        child.close()


def test_want_of_memory_in_opencv_is_want_of_memory() -> None:
    work = "import cv2, numpy; cv2.resize(numpy.zeros((9, 9)), (60000, 60000))"
    assert _in_a_child(work).returncode == OUT_OF_MEMORY


def test_too_large_a_result_is_told(server: ForkServer, tmp_path: Path) -> None:
    camera = "sim://studio?width=300&height=200&noise=off"
    with pytest.raises(OutputLimitError, match="larger than what a job may write"):
        _run(server, "capture", tmp_path, output_bytes=10_000, camera=camera)


def test_too_many_open_files_are_told(
    server: ForkServer, tmp_path: Path, png: Callable[..., bytes]
) -> None:
    _photographs(tmp_path, png(64, 48), png(64, 48, True))
    with pytest.raises(FileLimitError, match="more open files"):
        _run(server, "check", tmp_path, open_files=4)


@pytest.mark.parametrize(
    ("fault", "code"),
    [
        ("OSError(errno.ENOSPC, 'x')", DISK_FULL),
        ("OSError(errno.EDQUOT, 'x')", DISK_FULL),
        ("OSError(errno.EMFILE, 'x')", OUT_OF_FILES),
        ("OSError(errno.ENOMEM, 'x')", OUT_OF_MEMORY),
        ("MemoryError()", OUT_OF_MEMORY),
    ],
)
def test_what_the_system_refuses_is_an_exit_code(fault: str, code: int) -> None:
    done = _in_a_child(f"import errno; raise {fault}")
    assert (done.returncode, done.stdout) == (code, b"")


def test_a_child_has_all_its_limits() -> None:
    names = ("RLIMIT_AS", "RLIMIT_CPU", "RLIMIT_NOFILE", "RLIMIT_FSIZE")
    work = f"tell({{name: resource.getrlimit(getattr(resource, name)) for name in {names}}})"
    assert json.loads(_in_a_child(work).stdout) == {
        "RLIMIT_AS": [GIB, GIB],
        "RLIMIT_CPU": [60, 65],
        "RLIMIT_NOFILE": [64, 64],
        "RLIMIT_FSIZE": [GIB, GIB],
    }


def test_a_child_has_as_much_of_its_limits_as_the_system_allows() -> None:
    _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    done = _in_a_child("tell({'files': resource.getrlimit(resource.RLIMIT_NOFILE)})", 2**31)
    assert (done.returncode, json.loads(done.stdout)) == (0, {"files": [most, most]})

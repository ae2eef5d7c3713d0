from __future__ import annotations

import contextlib
import errno
import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from service.errors import NoProcessError
from service.workers import forkserver
from service.workers.forkserver import Child, ForkServer
from tests.unit.service.forked import NO_PROCESS_ONCE, fork_server, wait_until_gone


@contextlib.contextmanager
def _forked(server: ForkServer) -> Iterator[Child]:
    with contextlib.closing(server.fork()) as child:
        yield child


def _said(server: ForkServer) -> Any:
    """What a child prints as JSON until it ends well."""
    with _forked(server) as child:
        said = json.load(child.stdout)
        assert child.wait(60) == 0
    return said


_COUNTS = "counts.append(0); print(json.dumps([os.getpid(), os.getppid(), len(counts)]))"


def test_every_child_is_a_fresh_process_that_shares_the_imports() -> None:
    with contextlib.closing(fork_server(_COUNTS, "counts = [0, 0]")) as server:
        (first, parent, count), (second, same, again) = _said(server), _said(server)
    assert first != second
    assert parent == same
    assert count == again == 3


def test_a_server_that_was_killed_is_started_again() -> None:
    with contextlib.closing(fork_server(_COUNTS, "counts = []")) as server:
        _, parent, _ = _said(server)
        os.kill(parent, signal.SIGKILL)
        child, another, count = _said(server)
    assert parent not in (child, another)
    assert count == 1


def test_a_server_that_is_frozen_is_killed_and_started_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Else a job waited for its process for ever, and no limit or cancel would end that."""
    ask = forkserver._ask

    def ask_with_more_patience_the_next_time(*arguments: Any) -> Child | None:
        child = ask(*arguments)
        monkeypatch.setattr(forkserver, "_FORK_SECONDS", 60.0)
        return child

    with contextlib.closing(fork_server(_COUNTS, "counts = []")) as server:
        _, parent, _ = _said(server)
        os.kill(parent, signal.SIGSTOP)
        monkeypatch.setattr(forkserver, "_FORK_SECONDS", 0.2)
        monkeypatch.setattr(forkserver, "_ask", ask_with_more_patience_the_next_time)
        _, another, count = _said(server)
    assert (another != parent, count, wait_until_gone(parent)) == (True, 1, "gone")


@pytest.mark.parametrize("ended", ["its child", "itself"])
def test_a_server_that_is_frozen_keeps_nobody_from_ending(
    ended: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(forkserver, "_DEAF_SECONDS", 0.2)
    code = "print(json.dumps([os.getpid(), os.getppid()]), flush=True); time.sleep(600)"
    with contextlib.closing(fork_server(code)) as server:
        child = server.fork()
        pid, parent = json.loads(child.stdout.readline())
        os.kill(parent, signal.SIGSTOP)
        if ended == "itself":
            server.close()
        child.close()
        assert wait_until_gone(pid) in ("gone", "Z")
    assert wait_until_gone(parent) == "gone"


def test_children_die_with_their_server() -> None:
    code = "print(json.dumps([os.getpid(), os.getppid()]), flush=True); time.sleep(600)"
    with contextlib.closing(fork_server(code)) as server, _forked(server) as child:
        pid, parent = json.loads(child.stdout.readline())
        os.kill(parent, signal.SIGKILL)
        with pytest.raises(ChildProcessError, match="has died"):
            child.wait(60)
        assert wait_until_gone(pid) in ("gone", "Z")


def test_a_server_that_is_closed_ends_its_children() -> None:
    code = "print(json.dumps([os.getpid(), os.getppid()]), flush=True); time.sleep(600)"
    server = fork_server(code)
    with _forked(server) as child:
        pid, parent = json.loads(child.stdout.readline())
        server.close()
        with pytest.raises(ChildProcessError):
            child.wait(60)
    assert wait_until_gone(parent) == "gone"
    assert wait_until_gone(pid) in ("gone", "Z")


def test_nothing_outlives_a_killed_owner() -> None:
    owner = """
import sys
from tests.unit.service.forked import NO_PROCESS_ONCE, fork_server
server = fork_server('''
import subprocess
other = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
print(json.dumps([os.getpid(), os.getppid(), other.pid]), flush=True)
time.sleep(600)
''')
with_child = server.fork()
print(with_child.stdout.readline().decode(), flush=True)
sys.stdin.read()
"""
    with subprocess.Popen(
        [sys.executable, "-c", owner], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as process:
        assert process.stdout is not None
        pids = json.loads(process.stdout.readline())
        process.kill()
    assert len(pids) == 3
    assert all(wait_until_gone(pid) in ("gone", "Z") for pid in pids)


def test_what_a_child_started_ends_with_it() -> None:
    code = """
import subprocess
print(subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"]).pid, flush=True)
os._exit(0)
"""
    with contextlib.closing(fork_server(code)) as server:
        assert wait_until_gone(_said(server)) in ("gone", "Z")


def test_a_signal_to_all_processes_is_for_their_owner_alone() -> None:
    code = """
for number in (signal.SIGTERM, signal.SIGINT):
    os.kill(os.getppid(), number)
    os.kill(os.getpid(), number)
print(json.dumps("still here"))
"""
    with contextlib.closing(fork_server(code)) as server:
        assert [_said(server), _said(server)] == ["still here", "still here"]


def test_children_at_once_hold_nothing_of_each_other() -> None:
    code = """
print(json.dumps(sorted(map(int, os.listdir("/proc/self/fd")))), flush=True)
sys.stdin.read()
"""
    with contextlib.closing(fork_server(code)) as server, contextlib.ExitStack() as stack:
        children = [stack.enter_context(_forked(server)) for _ in range(3)]
        held = [json.loads(child.stdout.readline()) for child in children]
        assert all(len(one) == 4 for one in held), held  # three, and the one that lists them
        children[1].stdin.close()
        assert children[1].wait(60) == 0
        children[2].stdin.close()
        assert children[2].wait(60) == 0


def test_threads_fork_at_once() -> None:
    found: list[Any] = []
    with contextlib.closing(fork_server("print(os.getpid())")) as server:
        threads = [threading.Thread(target=lambda: found.append(_said(server))) for _ in range(8)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert len(set(found)) == 8


def test_a_child_that_still_runs_is_waited_for_in_vain() -> None:
    with (
        contextlib.closing(fork_server("time.sleep(600)")) as server,
        _forked(server) as child,
        pytest.raises(TimeoutError),
    ):
        child.wait(0.1)


def test_a_system_without_processes_costs_one_task_and_not_the_server() -> None:
    with contextlib.closing(fork_server("print(os.getpid())", NO_PROCESS_ONCE)) as server:
        with _forked(server) as child:
            assert (child.stdout.read(), child.wait(60)) == (b"", 71)
        assert _said(server) > 0


def _refusing(number: int) -> Callable[..., Any]:
    def refuse(*_arguments: object, **_named: object) -> None:
        raise OSError(number, os.strerror(number))

    return refuse


def _open_files() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


@pytest.mark.parametrize("number", [errno.EAGAIN, errno.ENOMEM, errno.EMFILE])
def test_a_system_that_starts_no_server_is_asked_again(
    number: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = _open_files()
    with contextlib.closing(fork_server("print(os.getpid())")) as server:
        with monkeypatch.context() as short:
            short.setattr(subprocess, "Popen", _refusing(number))
            server.start()
            with pytest.raises(NoProcessError):
                server.fork()
            assert _open_files() == before
        assert _said(server) > 0


@pytest.mark.parametrize("allowed", [0, 1])
def test_a_process_without_descriptors_leaves_none_open(
    allowed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    with contextlib.closing(fork_server("print(os.getpid())")) as server:
        assert _said(server) > 0
        before = _open_files()
        pipes = [os.pipe] * allowed + [_refusing(errno.EMFILE)]
        with monkeypatch.context() as short:
            short.setattr(os, "pipe", lambda: pipes.pop(0)())
            with pytest.raises(NoProcessError):
                server.fork()
        assert (pipes, _open_files()) == ([], before)
        assert _said(server) > 0


def test_a_program_that_is_not_there_is_no_want_of_processes() -> None:
    with (
        contextlib.closing(ForkServer(["/no/such/program"], {})) as server,
        pytest.raises(FileNotFoundError),
    ):
        server.fork()


def test_a_program_that_ends_at_once_is_told() -> None:
    server = ForkServer([sys.executable, "-c", "raise SystemExit(5)"], {})
    with contextlib.closing(server), pytest.raises(ChildProcessError, match="ends as soon as"):
        server.fork()


def test_nothing_is_left_open_by_one_that_was_never_used() -> None:
    before = len(list(Path("/proc/self/fd").iterdir()))
    fork_server("pass").close()
    with contextlib.closing(fork_server("pass")) as server:
        server.start()
    assert len(list(Path("/proc/self/fd").iterdir())) == before

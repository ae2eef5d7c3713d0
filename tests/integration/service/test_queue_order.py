"""The queue hands jobs out by rank, also those that another worker had."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import sqlalchemy as sa

from service.dbos_queue.queue import Queue, migrate
from service.rows import database

Start = Callable[..., subprocess.Popen[str]]


@pytest.fixture
def start(url: str) -> Iterator[Start]:
    """Start a noting_worker of a name, on a host."""
    started: list[subprocess.Popen[str]] = []

    def run(*named: str) -> subprocess.Popen[str]:
        program = Path(__file__).with_name("noting_worker.py")
        started.append(
            subprocess.Popen(
                [sys.executable, str(program), url, *named],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
            )
        )
        return started[-1]

    yield run
    for process in started:
        process.kill()
        process.communicate()


def _tell(worker: subprocess.Popen[str], line: str) -> None:
    assert worker.stdin is not None
    print(line, file=worker.stdin, flush=True)


def _said(worker: subprocess.Popen[str]) -> str:
    assert worker.stdout is not None
    return worker.stdout.readline().strip()


def test_low_ranks_go_first_also_after_a_takeover(url: str, start: Start) -> None:
    connected = database.connect(url)
    migrate(connected)
    queue = Queue(connected)

    def submit(job_id: str, rank: int) -> None:
        with connected.begin() as connection:
            queue.submit(connection, job_id, rank)

    submit("held", 40)
    dead = start("dead")
    assert _said(dead) == "held"
    dead.kill()
    dead.wait()
    submit("plug", 1)
    alive = start("alive")
    assert _said(alive) == "plug"
    for job_id, rank in (("last", 2**31 - 1), ("third", 41), ("first", 8), ("fourth", 41)):
        submit(job_id, rank)
    _tell(alive, "take over")
    assert _said(alive) == "taken over"
    _tell(alive, "go")
    assert [_said(alive) for _ in range(5)] == ["first", "held", "third", "fourth", "last"]
    queue.close()
    connected.dispose()


def test_what_hangs_on_a_host_waits_for_its_workers(url: str, start: Start) -> None:
    connected = database.connect(url)
    migrate(connected)
    queue = Queue(connected)
    other = start("other", "b")
    with connected.begin() as connection:
        for job_id, camera, host in (("on a", "1", "a"), ("on b", "2", "b"), ("on any", "3", None)):
            queue.submit_capture(connection, job_id, 1, camera, host)
    assert {_said(other), _said(other)} == {"on b", "on any"}
    dead = start("dead", "a")
    assert _said(dead) == "on a"
    dead.kill()
    dead.wait()
    _tell(other, "take over")
    assert _said(other) == "taken over"
    _tell(other, "go")
    with connected.begin() as connection:
        queue.submit_capture(connection, "also on b", 1, "1", "b")
    assert _said(other) == "also on b"  # in the camera's queue, were it the same
    assert _said(start("alive", "a")) == "on a"
    queue.close()
    connected.dispose()


def test_what_is_done_is_forgotten_and_what_waits_is_not(url: str, start: Start) -> None:
    connected = database.connect(url)
    migrate(connected)
    queue = Queue(connected)
    with connected.begin() as connection:
        for number in range(3):
            queue.submit(connection, f"done {number}", 1)
    worker = start("one")
    _tell(worker, "go")
    assert {_said(worker) for _ in range(3)} == {"done 0", "done 1", "done 2"}
    _tell(worker, "take over")  # it does so once it has launched, after what it runs has begun
    assert _said(worker) == "taken over"
    worker.kill()
    worker.wait()
    with connected.begin() as connection:
        queue.submit(connection, "waits", 1)
        queue.submit(connection, "withdrawn", 1)
    queue.withdraw("withdrawn")
    queue.forget_done(3600)
    assert {"waits", "withdrawn"} < _ids(connected)
    queue.forget_done(-3600)
    left = _ids(connected)
    assert "waits" in left and not {"withdrawn", "done 0", "done 1"} & left
    queue.close()
    connected.dispose()


def _ids(connected: sa.Engine) -> set[str]:
    """Ids of what the queue knows."""
    schema = "dbos." if connected.dialect.name == "postgresql" else ""
    with connected.connect() as connection:
        found = connection.exec_driver_sql(f"SELECT workflow_uuid FROM {schema}workflow_status")
        return set(found.scalars())

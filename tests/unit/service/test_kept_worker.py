from __future__ import annotations

import errno
import os
import threading
from types import SimpleNamespace

import pytest

from service.kept_worker import _keep_worker
from service.settings import Settings


class _Stop(threading.Event):
    """Notes the waits between starts, and is set after so many."""

    def __init__(self, waits: int) -> None:
        super().__init__()
        self.seconds: list[float | None] = []
        self._waits = waits

    def wait(self, timeout: float | None = None) -> bool:
        self.seconds.append(timeout)
        if len(self.seconds) == self._waits:
            self.set()
        return self.is_set()


class _Ended:
    """A worker that has ended once it is looked at."""

    def __init__(self, code: int) -> None:
        self.returncode = code

    def poll(self) -> int:
        return self.returncode


def _waits(
    codes: list[int], lives: list[float], monkeypatch: pytest.MonkeyPatch
) -> list[float | None]:
    """Have a worker end with these codes, after so many seconds; what is waited for in between."""
    ends, stop = iter(codes), _Stop(len(codes))
    times = iter([time for life in lives for time in (0.0, life)])
    monkeypatch.setattr("subprocess.Popen", lambda *_call, **_named: _Ended(next(ends)))
    # that module's alone: threads of other tests ask for the time, too
    clock = SimpleNamespace(monotonic=lambda: next(times))
    monkeypatch.setattr("service.kept_worker.time", clock)
    _keep_worker(Settings(), stop)
    return stop.seconds


def test_a_worker_that_ends_at_once_is_started_ever_less_often_and_told_once(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    waits = _waits([1] * 9, [0.5] * 9, monkeypatch)
    assert waits == [1, 2, 4, 8, 16, 32, 60, 60, 60]
    (record,) = caplog.records
    assert record.getMessage().startswith("the worker ended with code 1; starting another in 1 s")


def test_a_worker_that_had_begun_is_started_anew_within_a_second(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    waits = _waits([1, 1, -9, -9, 1], [0.5, 0.5, 0.5, 3600, 0.5], monkeypatch)
    assert waits == [1, 2, 4, 1, 2]
    told = [record.getMessage().partition(";")[0] for record in caplog.records]
    assert told == [f"the worker ended with code {code}" for code in (1, -9, -9, 1)]


def test_a_worker_for_which_there_is_no_process_is_started_later(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Else nobody started another until the whole service is started anew."""
    shortages = [BlockingIOError(errno.EAGAIN, os.strerror(errno.EAGAIN))]

    def start(*_call: object, **_named: object) -> _Ended:
        if shortages:
            raise shortages.pop()
        return _Ended(1)

    monkeypatch.setattr("subprocess.Popen", start)
    stop = _Stop(2)
    _keep_worker(Settings(), stop)
    assert stop.seconds == [1, 2]
    assert [record.getMessage().partition(";")[0] for record in caplog.records] == [
        "the worker could not be started, resource temporarily unavailable",
        "the worker ended with code 1",
    ]

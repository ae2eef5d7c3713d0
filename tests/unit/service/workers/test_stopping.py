from __future__ import annotations

import time
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest
import sqlalchemy as sa

from service.errors import DeadlineError
from service.rows import attempts, expiry, jobs
from service.workers import sandbox, stopping
from service.workers.stopping import ASK_SECONDS, Stopping
from tests.unit.service.job_rows import added, claimed


class Clock:
    """Time that passes only while somebody waits."""

    def __init__(self) -> None:
        self.now = 1000.0
        self.slept: list[float] = []

    def sleep(self, seconds: float) -> None:
        self.slept.append(seconds)
        self.now += seconds


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    module = SimpleNamespace(monotonic=lambda: clock.now, sleep=clock.sleep)
    monkeypatch.setattr(stopping, "time", module)
    return clock


def begun(engine: sa.Engine, ending: Callable[[], bool] = lambda: False, **values: Any) -> Stopping:
    """Stopping of an attempt at a job that runs."""
    added(engine, "a", **values)
    return Stopping(claimed(engine, "a", "w"), engine, ending, silence_seconds=3600.0)


def cancel(engine: sa.Engine) -> None:
    with engine.begin() as connection:
        jobs.request_cancel(connection, "a")


def test_a_job_that_was_canceled_is_found_at_the_next_look(engine: sa.Engine, clock: Clock) -> None:
    attempt = begun(engine)
    assert not attempt.is_due()
    cancel(engine)
    clock.now += ASK_SECONDS  # no look so soon
    assert not attempt.is_due()
    clock.now += 0.001
    assert attempt.is_due()
    with pytest.raises(sandbox.StoppedError):
        attempt.check()


def test_a_worker_that_ends_is_found_at_once(engine: sa.Engine, clock: Clock) -> None:
    ends = [False, True]
    attempt = begun(engine, ending=lambda: ends.pop(0))
    assert [attempt.is_due(), attempt.is_due()] == [False, True]
    assert clock.slept == []


def test_a_deadline_ends_what_goes_on_and_not_what_is_canceled(
    engine: sa.Engine, clock: Clock
) -> None:
    attempt = begun(engine, deadline=time.time() - 1.0)
    with pytest.raises(DeadlineError):
        attempt.check()
    cancel(engine)
    clock.now += 1.0
    assert attempt.is_due()


def test_a_database_that_is_away_ends_an_attempt_once_others_take_its_job_over(
    engine: sa.Engine, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    attempt = begun(engine)
    clock.now += 3000.0
    assert not attempt.is_due()  # from when on it is silent

    def away(*_arguments: Any) -> bool:
        raise sa.exc.OperationalError("", None, Exception("away"))

    monkeypatch.setattr(attempts, "must_stop", away)
    clock.now += 3600.0
    assert not attempt.is_due()
    clock.now += 1.0
    with pytest.raises(sa.exc.OperationalError):
        attempt.is_due()


def test_a_pause_is_as_long_as_asked_and_ends_with_the_job(engine: sa.Engine, clock: Clock) -> None:
    attempt = begun(engine)
    attempt.pause(0.6)
    assert clock.slept == pytest.approx([0.25, 0.25, 0.1])
    assert not attempt.is_void()
    with engine.begin() as connection:
        expiry.remove(connection, "a")
    assert attempt.is_void()
    clock.now += 1.0
    with pytest.raises(sandbox.StoppedError):
        attempt.pause(0.6)
    assert len(clock.slept) == 3

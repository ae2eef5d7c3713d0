"""Jobs that ask a person for something."""

from __future__ import annotations

import sqlalchemy as sa

from service.rows import attempts, heartbeats, jobs
from service.rows.states import State


def _find(engine: sa.Engine) -> jobs.Job:
    with engine.connect() as connection:
        job = jobs.find(connection, "a")
    assert job is not None
    return job


def _asked(engine: sa.Engine, seconds: float = 60) -> jobs.Job:
    row = {"id": "a", "options": {}, "trace_id": "1" * 32, "request_hash": ""}
    with engine.begin() as connection:
        jobs.add(connection, row)
        held = attempts.claim(connection, "a", "w1")
        assert held is not None
        attempts.ask_operator(connection, held, "Switch the flash off.", seconds)
    return held


def test_a_request_is_in_the_row_until_it_is_confirmed(engine: sa.Engine) -> None:
    held = _asked(engine)
    job = _find(engine)
    assert (job.request, job.requests) == ("Switch the flash off.", 1)
    assert job.request_until and 50 < job.request_until - job.created < 70
    with engine.begin() as connection:
        assert attempts.confirmed(connection, held) is None
        assert not attempts.must_stop(connection, held)
        assert jobs.confirm(connection, "a", 1)
        assert not jobs.confirm(connection, "a", 1)
        assert attempts.confirmed(connection, held) is True
    job = _find(engine)
    assert (job.request, job.requests, job.request_until) == (None, 1, None)


def test_a_confirmation_of_an_earlier_request_is_none_of_the_next(engine: sa.Engine) -> None:
    held = _asked(engine)
    with engine.begin() as connection:
        assert jobs.confirm(connection, "a", 1)
        attempts.ask_operator(connection, held, "Switch the flash on.", 60)
        assert not jobs.confirm(connection, "a", 1)
        assert jobs.confirm(connection, "a", 2)


def test_a_request_that_nobody_confirms_in_time_is_over(engine: sa.Engine) -> None:
    held = _asked(engine, seconds=-1)
    with engine.begin() as connection:
        assert attempts.confirmed(connection, held) is False
    job = _find(engine)
    assert (job.state, job.request) == (State.RUNNING, None)


def test_a_living_workers_request_is_nobody_elses(engine: sa.Engine) -> None:
    _asked(engine)
    with engine.begin() as connection:
        heartbeats.beat(connection, "w1")
        assert attempts.claim(connection, "a", "w2") is None


def test_a_dead_workers_request_goes_with_it(engine: sa.Engine) -> None:
    _asked(engine)
    with engine.begin() as connection:
        job = attempts.claim(connection, "a", "w2")  # the dead one has no row in workers
    assert job is not None
    assert (job.state, job.attempt, job.lost, job.request) == (State.RUNNING, 2, 1, None)
    with engine.begin() as connection:
        assert not jobs.confirm(connection, "a")

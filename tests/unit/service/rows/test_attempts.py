from __future__ import annotations

from functools import partial
from typing import Any

import pytest
import sqlalchemy as sa

from service.rows import attempts, expiry, heartbeats, jobs, tables
from service.rows.states import State
from tests.unit.service.asking import stored
from tests.unit.service.job_rows import added, claim, claimed, in_state


def _dies(engine: sa.Engine, worker: str) -> None:
    with engine.begin() as connection:
        heartbeats.leave(connection, worker)


def test_the_first_claim_wins(engine: sa.Engine) -> None:
    added(engine, "a")
    job = claimed(engine, "a", "w1")
    assert (job.state, job.attempt, job.lost, job.worker) == (State.RUNNING, 1, 0, "w1")
    assert job.started is not None and job.started >= job.created
    assert claim(engine, "a", "w2") is None


def test_nobody_claims_what_is_not_there(engine: sa.Engine) -> None:
    assert claim(engine, "a", "w1") is None


def test_results_make_a_job_succeed(engine: sa.Engine) -> None:
    added(engine, "a")
    held = claimed(engine, "a", "w1")
    with engine.begin() as connection:
        assert attempts.succeed(connection, held, [{"name": "lamp1.jpg", "size": 5}])
    job = stored(engine, "a")
    assert (job.state, job.worker, job.ended) == (State.SUCCEEDED, None, True)
    assert job.results == [{"name": "lamp1.jpg", "size": 5}]
    assert job.finished is not None and job.started is not None and job.finished >= job.started
    assert claim(engine, "a", "w2") is None


def test_an_error_makes_a_job_fail(engine: sa.Engine) -> None:
    added(engine, "a")
    held = claimed(engine, "a", "w1")
    with engine.begin() as connection:
        assert attempts.fail(connection, held, {"detail": "too dark"})
    job = stored(engine, "a")
    assert (job.state, job.error) == (State.FAILED, {"detail": "too dark"})


def test_a_dead_workers_job_is_taken_over_and_the_attempt_counts_as_lost(engine: sa.Engine) -> None:
    added(engine, "a")
    claimed(engine, "a", "w1")
    _dies(engine, "w1")
    job = claimed(engine, "a", "w2")
    assert (job.attempt, job.lost, job.worker) == (2, 1, "w2")


def test_a_job_has_started_with_its_first_attempt(engine: sa.Engine) -> None:
    added(engine, "a")
    claimed(engine, "a", "w1")
    with engine.begin() as connection:
        connection.execute(sa.update(tables.jobs).values(started=5.0))
    _dies(engine, "w1")
    assert claimed(engine, "a", "w2").started == 5.0


def test_an_attempt_that_was_taken_over_writes_nothing(engine: sa.Engine) -> None:
    added(engine, "a")
    frozen = claimed(engine, "a", "w1")
    _dies(engine, "w1")
    current = claimed(engine, "a", "w2")
    with engine.begin() as connection:
        assert attempts.must_stop(connection, frozen)
        attempts.report(connection, frozen, "layers", 0.9)
        assert not attempts.set_inputs(connection, frozen, {"flash": "other"}, 1, {})
        assert not attempts.succeed(connection, frozen, [{"name": "old", "size": 1}])
        assert not attempts.fail(connection, frozen, {"detail": "old"})
        attempts.release(connection, frozen)
        assert not attempts.must_stop(connection, current)
    assert stored(engine, "a") == current


def test_progress_is_written(engine: sa.Engine) -> None:
    added(engine, "a")
    held = claimed(engine, "a", "w1")
    with engine.begin() as connection:
        attempts.report(connection, held, "layers", 0.25)
    job = stored(engine, "a")
    assert (job.stage, job.fraction) == ("layers", 0.25)


def test_a_released_job_waits_again_and_has_lost_nothing(engine: sa.Engine) -> None:
    added(engine, "a")
    held = claimed(engine, "a", "w1")
    with engine.begin() as connection:
        attempts.report(connection, held, "layers", 0.25)
        attempts.release(connection, held)
    job = stored(engine, "a")
    assert (job.state, job.worker, job.stage, job.fraction) == (State.QUEUED, None, None, 0.0)
    again = claimed(engine, "a", "w2")
    assert (again.attempt, again.lost) == (2, 0)


def test_an_attempt_that_was_put_back_or_has_ended_writes_nothing(engine: sa.Engine) -> None:
    """Its number is that of the row until the next one begins."""
    added(engine, "a")
    for end in (attempts.release, partial(attempts.fail, error={})):
        held = claimed(engine, "a", "w1")
        with engine.begin() as connection:
            assert end(connection, held)
        before = stored(engine, "a")
        with engine.begin() as connection:
            attempts.report(connection, held, "decode", 0.5)
            assert not attempts.set_inputs(connection, held, {}, 1, None)
            assert attempts.must_stop(connection, held)
        assert stored(engine, "a") == before


def test_a_dead_workers_canceled_job_stays_so(engine: sa.Engine) -> None:
    added(engine, "a")
    claimed(engine, "a", "w1")
    with engine.begin() as connection:
        jobs.request_cancel(connection, "a")
    _dies(engine, "w1")
    job = claimed(engine, "a", "w2")
    assert job.state == State.CANCELING
    with engine.begin() as connection:
        assert attempts.acknowledge_cancel(connection, job)


@pytest.mark.parametrize("dead", [State.RUNNING, State.CANCELING])
def test_a_takeover_is_another_attempt_in_the_same_state(dead: State, engine: sa.Engine) -> None:
    in_state(engine, dead)
    _dies(engine, "w1")
    job = claimed(engine, "a", "w2")
    assert (job.state, job.attempt, job.lost, job.worker) == (dead, 2, 1, "w2")


def test_a_takeover_ends_what_the_dead_worker_asked_its_operator_for(engine: sa.Engine) -> None:
    """Else the job would run, and still show what nobody waits for."""
    in_state(engine, State.WAITING_FOR_OPERATOR)
    _dies(engine, "w1")
    job = claimed(engine, "a", "w2")
    assert (job.state, job.attempt, job.lost) == (State.RUNNING, 2, 1)
    assert (job.request, job.request_until) == (None, None)


def test_a_removed_job_tells_its_attempt_to_stop(engine: sa.Engine) -> None:
    added(engine, "a")
    held = claimed(engine, "a", "w1")
    with engine.begin() as connection:
        expiry.remove(connection, "a")
        assert attempts.must_stop(connection, held)
        assert not attempts.succeed(connection, held, [])
        assert jobs.find(connection, "a") is None


def test_a_lost_attempt_is_counted_and_the_job_keeps_its_rank(engine: sa.Engine) -> None:
    first = added(engine, "a")
    held = claimed(engine, "a", "w1")
    with engine.begin() as connection:
        attempts.report(connection, held, "layers", 0.25)
        attempts.lose(connection, held)
    job = stored(engine, "a")
    assert (job.state, job.worker, job.stage, job.fraction) == (State.QUEUED, None, None, 0.0)
    assert (job.lost, job.attempt, job.rank) == (1, 1, first.rank)


def test_a_worker_takes_back_what_it_holds_without_knowing(engine: sa.Engine) -> None:
    """The answer to its claim got lost; nothing died, so no attempt counts as lost."""
    added(engine, "a")
    claimed(engine, "a", "w1")
    again = claim(engine, "a", "w1")
    assert again is not None
    assert (again.state, again.attempt, again.lost, again.worker) == (State.RUNNING, 2, 0, "w1")


def test_a_job_tells_which_attempt_has_taken_its_pair(engine: sa.Engine) -> None:
    def inputs(place: str) -> dict[str, Any]:
        keys = {frame: f"jobs/a/inputs/{place}{frame}" for frame in ("no_flash", "flash")}
        return {frame: {"key": key, "sha256": ""} for frame, key in keys.items()}

    job = added(engine, "a", inputs=inputs("11/") | {"camera": {"make": "jobs/a/inputs/1/"}})
    assert [attempt for attempt in range(13) if job.has_pair_of(attempt)] == [11]
    sent = added(engine, "b", inputs=inputs(""))
    assert not any(sent.has_pair_of(attempt) for attempt in range(3))
    assert not added(engine, "c").has_pair_of(1)

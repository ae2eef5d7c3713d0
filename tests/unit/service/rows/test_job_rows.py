from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
import sqlalchemy as sa

from service.rows import attempts, database, expiry, heartbeats, jobs
from service.rows.states import NEXT, State
from tests.unit.service.asking import stored
from tests.unit.service.job_rows import added, claim, claimed


def _dies(engine: sa.Engine, worker: str) -> None:
    with engine.begin() as connection:
        heartbeats.leave(connection, worker)


def test_a_new_job_is_queued(engine: sa.Engine) -> None:
    job = added(engine, "a", options={"lights": 2})
    assert (job.state, job.attempt, job.lost, job.ended) == (State.QUEUED, 0, 0, False)
    assert (job.options, job.worker, job.results, job.error) == ({"lights": 2}, None, None, None)
    assert job.created > 1.7e9


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
        connection.execute(sa.update(database.jobs).values(started=5.0))
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


def test_a_queued_job_is_canceled_at_once(engine: sa.Engine) -> None:
    added(engine, "a")
    with engine.begin() as connection:
        jobs.request_cancel(connection, "a")
    job = stored(engine, "a")
    assert job.state == State.CANCELED
    assert job.finished is not None
    assert claim(engine, "a", "w1") is None


def test_a_running_job_is_canceled_by_its_worker(engine: sa.Engine) -> None:
    added(engine, "a")
    held = claimed(engine, "a", "w1")
    with engine.begin() as connection:
        jobs.request_cancel(connection, "a")
        assert attempts.must_stop(connection, held)
        assert not attempts.succeed(connection, held, [])
    assert stored(engine, "a").state == State.CANCELING
    with engine.begin() as connection:
        assert attempts.acknowledge_cancel(connection, held)
    assert stored(engine, "a").state == State.CANCELED


def test_a_canceled_job_is_not_put_back(engine: sa.Engine) -> None:
    added(engine, "a")
    held = claimed(engine, "a", "w1")
    with engine.begin() as connection:
        jobs.request_cancel(connection, "a")
        attempts.release(connection, held)
    assert stored(engine, "a").state == State.CANCELING


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


def test_an_ended_job_cannot_be_canceled(engine: sa.Engine) -> None:
    added(engine, "a")
    held = claimed(engine, "a", "w1")
    with engine.begin() as connection:
        attempts.succeed(connection, held, [])
        jobs.request_cancel(connection, "a")
    assert stored(engine, "a").state == State.SUCCEEDED


def _in_state(engine: sa.Engine, state: State) -> jobs.Job:
    """Bring a job to a state; the attempt that worked on it last."""
    added(engine, "a")
    held = claimed(engine, "a", "w1")
    with engine.begin() as connection:
        if state == State.QUEUED:
            attempts.release(connection, held)
        if state == State.WAITING_FOR_OPERATOR:
            _ask(connection, held)
        if state in (State.CANCELING, State.CANCELED):
            jobs.request_cancel(connection, "a")
        if state == State.CANCELED:
            attempts.acknowledge_cancel(connection, held)
        if state == State.SUCCEEDED:
            attempts.succeed(connection, held, [])
        if state == State.FAILED:
            attempts.fail(connection, held, {})
        if state == State.EXPIRED:
            attempts.succeed(connection, held, [])
            expiry.condemn(connection, "a")
    assert stored(engine, "a").state == state
    return held


def _ask(connection: sa.Connection, held: jobs.Job) -> None:
    attempts.ask_operator(connection, held, "Switch the flash off.", 60)


_BEGUN = (State.RUNNING, State.WAITING_FOR_OPERATOR)

WRITES: dict[str, tuple[Callable[[sa.Connection, jobs.Job], object], dict[State, State]]] = {
    "claim": (
        lambda connection, _held: attempts.claim(connection, "a", "w2"),
        {State.QUEUED: State.RUNNING},
    ),
    "request_cancel": (
        lambda connection, _held: jobs.request_cancel(connection, "a"),
        {State.QUEUED: State.CANCELED, **dict.fromkeys(_BEGUN, State.CANCELING)},
    ),
    "acknowledge_cancel": (attempts.acknowledge_cancel, {State.CANCELING: State.CANCELED}),
    "succeed": (
        lambda connection, held: attempts.succeed(connection, held, []),
        {State.RUNNING: State.SUCCEEDED},
    ),
    "fail": (
        lambda connection, held: attempts.fail(connection, held, {}),
        dict.fromkeys(_BEGUN, State.FAILED),
    ),
    "fail_waiting": (
        lambda connection, _held: jobs.fail_waiting(connection, "a", {}),
        {State.QUEUED: State.FAILED},
    ),
    "release": (attempts.release, dict.fromkeys(_BEGUN, State.QUEUED)),
    "lose": (attempts.lose, dict.fromkeys(_BEGUN, State.QUEUED)),
    "ask_operator": (_ask, {State.RUNNING: State.WAITING_FOR_OPERATOR}),
    "confirm": (lambda one, _held: jobs.confirm(one, "a"), {_BEGUN[1]: State.RUNNING}),
    "confirmed": (attempts.confirmed, {}),
    "report": (lambda connection, held: attempts.report(connection, held, "layers", 0.5), {}),
    "set_inputs": (lambda connection, held: attempts.set_inputs(connection, held, {}, 0, {}), {}),
    "condemn": (
        lambda connection, _held: expiry.condemn(connection, "a"),
        dict.fromkeys([State.SUCCEEDED, State.FAILED, State.CANCELED], State.EXPIRED),
    ),
}


@pytest.mark.parametrize("state", State)
@pytest.mark.parametrize("write", WRITES)
def test_a_write_moves_a_job_only_from_where_it_may(
    write: str, state: State, engine: sa.Engine
) -> None:
    held = _in_state(engine, state)
    before = stored(engine, "a")
    do, moves = WRITES[write]
    with engine.begin() as connection:
        do(connection, held)
    after = stored(engine, "a")
    assert after.state == moves.get(state, state)
    if before.ended and state not in moves and write != "condemn":
        assert after == before


@pytest.mark.parametrize("state", State)
def test_an_attempt_goes_on_while_it_runs_or_asks_its_operator(
    state: State, engine: sa.Engine
) -> None:
    held = _in_state(engine, state)
    with engine.connect() as connection:
        assert attempts.must_stop(connection, held) == (state not in _BEGUN)


def test_the_writes_go_every_way_of_the_table_and_no_other() -> None:
    gone = {way for _, moves in WRITES.values() for way in moves.items()}
    assert gone == {(state, later) for state in State for later in NEXT[state]}


@pytest.mark.parametrize("dead", [State.RUNNING, State.CANCELING])
def test_a_takeover_is_another_attempt_in_the_same_state(dead: State, engine: sa.Engine) -> None:
    _in_state(engine, dead)
    _dies(engine, "w1")
    job = claimed(engine, "a", "w2")
    assert (job.state, job.attempt, job.lost, job.worker) == (dead, 2, 1, "w2")


def test_a_takeover_ends_what_the_dead_worker_asked_its_operator_for(engine: sa.Engine) -> None:
    """Else the job would run, and still show what nobody waits for."""
    _in_state(engine, State.WAITING_FOR_OPERATOR)
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


def test_an_idempotency_key_makes_one_job(engine: sa.Engine) -> None:
    added(engine, "a", idempotency_key="key")
    with pytest.raises(sa.exc.IntegrityError):
        added(engine, "b", idempotency_key="key")
    with engine.connect() as connection:
        found = jobs.find_by_key(connection, "", "key")
        assert found is not None and found.id == "a"
        assert jobs.find_by_key(connection, "", "other") is None


def test_jobs_without_a_key_do_not_clash(engine: sa.Engine) -> None:
    assert [added(engine, job_id).id for job_id in "ab"] == ["a", "b"]


def test_a_lost_attempt_is_counted_and_the_job_keeps_its_rank(engine: sa.Engine) -> None:
    first = added(engine, "a")
    held = claimed(engine, "a", "w1")
    with engine.begin() as connection:
        attempts.report(connection, held, "layers", 0.25)
        attempts.lose(connection, held)
    job = stored(engine, "a")
    assert (job.state, job.worker, job.stage, job.fraction) == (State.QUEUED, None, None, 0.0)
    assert (job.lost, job.attempt, job.rank) == (1, 1, first.rank)


def test_a_job_has_a_deadline_from_now(engine: sa.Engine) -> None:
    row = {"id": "a", "options": {}, "trace_id": "t", "request_hash": "h"}
    with engine.begin() as connection:
        jobs.add(connection, row, deadline_seconds=50)
    job = stored(engine, "a")
    assert job.deadline == pytest.approx(job.created + 50, abs=0.1)


def _cancel_running(connection: sa.Connection, held: jobs.Job, keep: float | None) -> None:
    jobs.request_cancel(connection, held.id, keep)
    assert attempts.acknowledge_cancel(connection, held, keep)


def _cancel_waiting(connection: sa.Connection, held: jobs.Job, keep: float | None) -> None:
    attempts.release(connection, held)
    jobs.request_cancel(connection, held.id, keep)


ENDS: dict[str, Callable[[sa.Connection, jobs.Job, float | None], object]] = {
    "succeeded": lambda connection, held, keep: attempts.succeed(
        connection, held, [], keep_seconds=keep
    ),
    "failed": lambda connection, held, keep: attempts.fail(connection, held, {}, keep),
    "canceled": _cancel_running,
    "canceled while it waits": _cancel_waiting,
}


@pytest.mark.parametrize("end", ENDS)
def test_a_job_that_ends_knows_how_long_it_is_kept(end: str, engine: sa.Engine) -> None:
    for job_id, keep in (("a", 60.0), ("b", None)):
        added(engine, job_id)
        held = claimed(engine, job_id, "w1")
        with engine.begin() as connection:
            ENDS[end](connection, held, keep)
    dated, endless = stored(engine, "a"), stored(engine, "b")
    assert dated.ended and endless.ended
    assert dated.finished is not None
    assert dated.expires == pytest.approx(dated.finished + 60, abs=0.1)
    assert endless.expires is None


def test_ids_of_jobs_are_told_from_others(engine: sa.Engine) -> None:
    added(engine, "a")
    with engine.connect() as connection:
        assert jobs.known(connection, ["a", "b"]) == {"a"}


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

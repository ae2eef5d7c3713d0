from __future__ import annotations

from collections.abc import Callable

import pytest
import sqlalchemy as sa

from service.rows import attempts, expiry, jobs
from service.rows.states import NEXT, State
from tests.unit.service.asking import stored
from tests.unit.service.job_rows import added, ask, claim, claimed, in_state


def test_a_new_job_is_queued(engine: sa.Engine) -> None:
    job = added(engine, "a", options={"lights": 2})
    assert (job.state, job.attempt, job.lost, job.ended) == (State.QUEUED, 0, 0, False)
    assert (job.options, job.worker, job.results, job.error) == ({"lights": 2}, None, None, None)
    assert job.created > 1.7e9


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


def test_an_ended_job_cannot_be_canceled(engine: sa.Engine) -> None:
    added(engine, "a")
    held = claimed(engine, "a", "w1")
    with engine.begin() as connection:
        attempts.succeed(connection, held, [])
        jobs.request_cancel(connection, "a")
    assert stored(engine, "a").state == State.SUCCEEDED


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
    "ask_operator": (ask, {State.RUNNING: State.WAITING_FOR_OPERATOR}),
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
    held = in_state(engine, state)
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
    held = in_state(engine, state)
    with engine.connect() as connection:
        assert attempts.must_stop(connection, held) == (state not in _BEGUN)


def test_the_writes_go_every_way_of_the_table_and_no_other() -> None:
    gone = {way for _, moves in WRITES.values() for way in moves.items()}
    assert gone == {(state, later) for state in State for later in NEXT[state]}


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

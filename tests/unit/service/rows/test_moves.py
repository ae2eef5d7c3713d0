from __future__ import annotations

from typing import Any

import pytest
import sqlalchemy as sa
from prometheus_client import REGISTRY

from service.rows import moves, tables
from service.rows.states import State
from tests.unit.service.asking import stored
from tests.unit.service.job_rows import added, claimed

ALL = sa.true()
A = tables.jobs.c.id == "a"


def _count(state: State) -> float:
    return REGISTRY.get_sample_value("lightlayers_jobs_finished_total", {"outcome": state}) or 0.0


def test_a_move_writes_the_state_and_what_else_becomes_of_the_row(engine: sa.Engine) -> None:
    before, other = added(engine, "a"), added(engine, "b")
    with engine.begin() as connection:
        assert moves.move(connection, State.RUNNING, A, worker="w", fraction=0.5)
    after = stored(engine, "a")
    assert (after.state, after.worker, after.fraction) == (State.RUNNING, "w", 0.5)
    assert after.revision == before.revision + 1  # by which those who watch it see that it changed
    assert stored(engine, "b") == other


def test_a_move_leaves_jobs_from_where_there_is_no_way(engine: sa.Engine) -> None:
    before, ended = added(engine, "a"), _count(State.SUCCEEDED)
    with engine.begin() as connection:
        assert not moves.move(connection, State.SUCCEEDED, A, fraction=1.0)
        assert not moves.end(connection, A, State.SUCCEEDED, 60)
        assert not moves.move(connection, State.RUNNING, tables.jobs.c.id == "nothing")
    assert (stored(engine, "a"), _count(State.SUCCEEDED)) == (before, ended)


def test_a_move_of_several_jobs_takes_those_that_may_go(engine: sa.Engine) -> None:
    """It is no compare-and-set of one then, so it does not say that it was."""
    for job_id in "abc":
        added(engine, job_id)
    claimed(engine, "c", "w")
    ended = _count(State.CANCELED)
    with engine.begin() as connection:
        assert not moves.end(connection, ALL, State.CANCELED, None)
        assert _count(State.CANCELED) == ended  # nothing is committed yet
    assert [stored(engine, job_id).state for job_id in "abc"] == ["canceled", "canceled", "running"]
    assert _count(State.CANCELED) == ended + 2


@pytest.mark.parametrize("asked", [{}, {"request": "Switch it on.", "request_until": 9e9}])
def test_a_request_ends_with_any_move_but_one_that_makes_it(
    asked: dict[str, Any], engine: sa.Engine
) -> None:
    added(engine, "a", state=State.RUNNING, request="Switch it off.", request_until=1.0)
    with engine.begin() as connection:
        assert moves.move(connection, State.WAITING_FOR_OPERATOR, A, **asked)
    job = stored(engine, "a")
    assert (job.request, job.request_until) == (asked.get("request"), asked.get("request_until"))


@pytest.mark.parametrize("state", [State.SUCCEEDED, State.FAILED])
def test_a_job_that_ends_is_nobodys_any_more(state: State, engine: sa.Engine) -> None:
    added(engine, "a", eta=5.0)
    claimed(engine, "a", "w")
    with engine.begin() as connection:
        connection.execute(sa.update(tables.jobs).values(eta=5.0))
        assert moves.end(connection, A, state, None, error={"detail": "too dark"})
    job = stored(engine, "a")
    assert (job.state, job.worker, job.eta, job.expires) == (state, None, None, None)
    assert job.error == {"detail": "too dark"}
    assert job.finished is not None and job.started is not None and job.finished >= job.started


def test_a_job_is_kept_from_its_end_on_unless_it_was_condemned(engine: sa.Engine) -> None:
    added(engine, "a")
    added(engine, "b", expires=1.0)
    with engine.begin() as connection:
        moves.end(connection, ALL, State.FAILED, 60)
    job = stored(engine, "a")
    assert job.finished is not None and job.expires is not None
    assert job.expires - job.finished == pytest.approx(60, abs=0.1)
    assert stored(engine, "b").expires == 1.0


def test_a_condemned_job_stays_so_where_others_are_kept_for_ever(engine: sa.Engine) -> None:
    added(engine, "a", expires=1.0)
    with engine.begin() as connection:
        assert moves.end(connection, A, State.FAILED, None)
    assert stored(engine, "a").expires == 1.0


def test_a_removal_is_no_second_end(engine: sa.Engine) -> None:
    added(engine, "a")
    counts = [_count(state) for state in (State.FAILED, State.EXPIRED)]
    with engine.begin() as connection:
        assert moves.end(connection, A, State.FAILED, None)
        assert moves.move(connection, State.EXPIRED, A)
        assert not moves.move(connection, State.EXPIRED, A)
    assert [_count(state) for state in (State.FAILED, State.EXPIRED)] == [counts[0] + 1, counts[1]]
    assert stored(engine, "a").state == State.EXPIRED

"""Rows of jobs that are kept no longer; their files: test_retention.py."""

from __future__ import annotations

from typing import Any

import pytest
import sqlalchemy as sa

from service.rows import attempts, expiry, jobs
from service.rows.states import ENDED, State
from tests.plans import plans
from tests.unit.service.asking import stored
from tests.unit.service.job_rows import added, claimed

PAST, FUTURE = 1.0, 9e9
TABLE = {"kind": "flash", "setup": "table"}


def test_only_ended_jobs_past_their_time_expire(engine: sa.Engine) -> None:
    for job_id, expires in (("a", 1.0), ("b", 9e9), ("c", None), ("d", 1.0), ("e", 1.0)):
        added(engine, job_id, expires=expires)
        if job_id == "d":
            continue
        held = claimed(engine, job_id, "w1")
        if job_id == "e":
            continue
        with engine.begin() as connection:
            attempts.succeed(connection, held, [])
    with engine.begin() as connection:
        assert expiry.expire(connection, 10) == ["a"]
    assert [stored(engine, job_id).state for job_id in "abcde"] == [
        State.EXPIRED,
        State.SUCCEEDED,
        State.SUCCEEDED,
        State.QUEUED,
        State.RUNNING,
    ]
    with engine.begin() as connection:  # until its row is gone, it is still to be removed
        assert expiry.expire(connection, 10) == ["a"]
        expiry.remove(connection, "a")
        assert expiry.expire(connection, 10) == []


def test_a_condemned_job_expires_once_it_has_ended(engine: sa.Engine) -> None:
    added(engine, "a")
    held = claimed(engine, "a", "w1")
    with engine.begin() as connection:
        jobs.request_cancel(connection, "a", 100)
        expiry.condemn(connection, "a")
        assert expiry.expire(connection, 10) == []
        assert attempts.acknowledge_cancel(connection, held, 100)
        assert expiry.expire(connection, 10) == ["a"]


def test_what_was_to_be_kept_for_ever_is_dated_from_its_end(engine: sa.Engine) -> None:
    for job_id in "abc":
        added(engine, job_id)
    for job_id in "ab":
        held = claimed(engine, job_id, "w1")
        with engine.begin() as connection:
            attempts.succeed(connection, held, [])
    with engine.begin() as connection:
        assert [expiry.limit_keeping(connection, 60, 1) for _ in range(3)] == [1, 1, 0]
    for job_id in "ab":
        job = stored(engine, job_id)
        assert job.finished is not None and job.expires == pytest.approx(job.finished + 60)
    assert stored(engine, "c").expires is None


@pytest.mark.parametrize(
    ("values", "dated"),
    [
        ({"state": State.FAILED, "options": TABLE}, True),
        ({"state": State.SUCCEEDED, "options": TABLE}, False),
        ({"state": State.SUCCEEDED, "options": {"kind": "flash"}}, True),
        ({"state": State.SUCCEEDED, "options": {**TABLE, "setup": None}}, True),
        ({"state": State.SUCCEEDED, "options": {"setup": "table"}, "likeness": "separate-"}, True),
        ({"state": State.EXPIRED, "options": {}}, False),
        ({"state": State.RUNNING, "options": {}}, False),
    ],
)
def test_calibrations_that_are_kept_for_a_setup_get_no_date(
    values: dict[str, Any], dated: bool, engine: sa.Engine
) -> None:
    before = added(engine, "a", **{"likeness": "calibrate-flash", "finished": 50.0, **values})
    with engine.begin() as connection:
        assert expiry.limit_keeping(connection, 60, 10) == dated
    after = stored(engine, "a")
    assert after.expires == (110.0 if dated else None)
    assert after.revision == before.revision + dated


@pytest.mark.parametrize(
    ("values", "goes"),
    [
        ({}, True),
        ({"expires": FUTURE}, False),
        ({"expires": None}, False),
        ({"webhook": {"url": "u"}}, False),  # it is not told yet
        ({"webhook": {"url": "u"}, "delivery": {"state": "pending"}}, False),
        ({"webhook": {"url": "u"}, "delivery": {"state": "delivered"}}, True),
        ({"webhook": {"url": "u"}, "delivery": {"state": "failed"}}, True),
        ({"webhook": {"url": "u"}, "finished": PAST}, True),  # deleted before it came to that
        ({"webhook": {"url": "u"}, "finished": PAST, "expires": FUTURE}, False),
    ],
)
def test_a_job_goes_when_it_has_ended_its_time_is_over_and_its_webhook_told(
    values: dict[str, Any], goes: bool, engine: sa.Engine
) -> None:
    for state in State:
        added(engine, state, **{"state": state, "expires": PAST, "finished": 0.5, **values})
    going = set(ENDED) if goes else {State.EXPIRED}  # whose removal was cut short
    with engine.begin() as connection:
        assert expiry.due(connection) == going
        assert set(expiry.expire(connection, 10)) == going
    for state in State:
        assert stored(engine, state).state == (State.EXPIRED if state in going else state)


def test_the_first_that_are_due_go_first_and_by_their_index(engine: sa.Engine) -> None:
    for job_id, expires in (("a", 3.0), ("b", 1.0), ("c", 2.0)):
        added(engine, job_id, state=State.FAILED, expires=expires)
    with engine.begin() as connection, plans(engine) as found:
        assert sorted(expiry.expire(connection, 2)) == ["b", "c"]
        assert expiry.due(connection) == {"a", "b", "c"}
        assert len(expiry.expire(connection, 1)) == 1
    assert stored(engine, "a").state == State.EXPIRED
    assert "USING INDEX jobs_by_expiry" in found[0]


def test_a_job_that_goes_on_is_condemned_and_moves_when_it_has_ended(engine: sa.Engine) -> None:
    before = added(engine, "a")
    with engine.begin() as connection:
        expiry.condemn(connection, "a")
    after = stored(engine, "a")
    assert (after.state, after.revision) == (State.QUEUED, before.revision + 1)
    assert after.expires == pytest.approx(before.created, abs=60)

from __future__ import annotations

from typing import Any

import pytest
import sqlalchemy as sa

from service import database, jobs
from tests.unit.service.asking import stored
from tests.unit.service.job_rows import added, claimed


def test_pages_go_from_new_to_old_and_meet_every_job_once(engine: sa.Engine) -> None:
    for job_id in "abcdef":
        added(engine, job_id)
    with engine.begin() as connection:  # some of one moment
        rounded = sa.func.round(database.jobs.c.created)
        connection.execute(sa.update(database.jobs).values(created=rounded))
    created = [stored(engine, job_id) for job_id in "cafebd"]
    expected = sorted(created, key=lambda job: (job.created, job.id), reverse=True)
    with engine.connect() as connection:
        first = jobs.page(connection, "", 4, None)
        second = jobs.page(connection, "", 4, (first[-1].created, first[-1].id))
    assert [job.id for job in first + second] == [job.id for job in expected]
    assert len(first) == 4


@pytest.mark.parametrize("owner", [None, "x"])
def test_pages_of_jobs_are_found_by_an_index(engine: sa.Engine, owner: str | None) -> None:
    last = added(engine, "a")
    plans = []

    @sa.event.listens_for(engine, "before_cursor_execute")
    def explain(_c: object, cursor: Any, query: str, values: Any, *_more: object) -> None:
        plans.append(cursor.execute(f"EXPLAIN QUERY PLAN {query}", values).fetchall())

    with engine.connect() as connection:
        jobs.page(connection, owner, 2, None)
        jobs.page(connection, owner, 2, (last.created, last.id))
    index = "jobs_by_age" if owner else "jobs_by_time"
    assert [len(plan) for plan in plans] == [1, 1]  # neither a sort
    assert all(f"USING INDEX {index}" in str(plan) for plan in plans)


def test_places_in_the_queue_count_from_one_and_skip_what_runs(engine: sa.Engine) -> None:
    queue = [added(engine, job_id) for job_id in "abcd"]
    assert [job.rank for job in queue] == [4, 8, 12, 16]
    claimed(engine, queue[0].id, "w1")
    with engine.connect() as connection:
        places = jobs.positions(connection, [stored(engine, job.id) for job in queue])
        assert jobs.count_queued(connection) == jobs.count_queued(connection, "") == 3
        assert jobs.count_queued(connection, "another") == 0
    assert places == {queue[1].id: 1, queue[2].id: 2, queue[3].id: 3}


def test_a_place_in_the_queue_is_that_of_the_rank(engine: sa.Engine) -> None:
    names = {"a": "one", "b": "one", "c": "one", "d": "another"}
    queue = [added(engine, job_id, owner=owner) for job_id, owner in names.items()]
    with engine.connect() as connection:
        places = jobs.positions(connection, queue)
    assert places == {"a": 1, "d": 2, "b": 3, "c": 4}

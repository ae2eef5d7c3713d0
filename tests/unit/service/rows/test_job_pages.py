from __future__ import annotations

import pytest
import sqlalchemy as sa

from service.rows import jobs, tables
from service.rows.states import State
from tests.plans import plans
from tests.unit.service.asking import stored
from tests.unit.service.job_rows import added


def test_pages_go_from_new_to_old_and_meet_every_job_once(engine: sa.Engine) -> None:
    for job_id in "abcdef":
        added(engine, job_id)
    with engine.begin() as connection:  # some of one moment
        rounded = sa.func.round(tables.jobs.c.created)
        connection.execute(sa.update(tables.jobs).values(created=rounded))
    created = [stored(engine, job_id) for job_id in "cafebd"]
    expected = sorted(created, key=lambda job: (job.created, job.id), reverse=True)
    with engine.connect() as connection:
        first = jobs.page(connection, "", 4, None)
        second = jobs.page(connection, "", 4, (first[-1].created, first[-1].id))
    assert [job.id for job in first + second] == [job.id for job in expected]
    assert len(first) == 4


@pytest.mark.parametrize("state", [None, State.FAILED])
def test_the_newest_jobs_of_a_state_are_found_by_an_index(
    state: State | None, engine: sa.Engine
) -> None:
    with engine.connect() as connection, plans(engine) as found:
        assert jobs.page(connection, None, 100, state=state) == []
    (plan,) = found
    assert f"USING INDEX {'jobs_by_state' if state else 'jobs_by_time'}" in plan
    assert "TEMP B-TREE" not in plan


def test_as_many_jobs_fit_a_page_as_have_short_options_together(
    engine: sa.Engine, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(jobs, "PAGE_CHARACTERS", 2 * len('{"name": "long"}'))
    for number in range(4):
        added(engine, f"long{number}", options={"name": "long"})
    last = added(engine, "longest", options={"name": "long" * 10})
    with engine.connect() as connection:
        assert jobs.count_fitting(connection, "", 50, None) == 1
        assert jobs.count_fitting(connection, "", 50, (last.created, last.id)) == 2
        assert jobs.count_fitting(connection, "", 1, (last.created, last.id)) == 1
        assert jobs.count_fitting(connection, "another", 50, None) == 1


@pytest.mark.parametrize("owner", [None, "x"])
def test_pages_of_jobs_are_found_by_an_index(engine: sa.Engine, owner: str | None) -> None:
    last = added(engine, "a")
    with engine.connect() as connection, plans(engine) as found:
        jobs.page(connection, owner, 2, None)
        jobs.page(connection, owner, 2, (last.created, last.id))
        jobs.count_fitting(connection, owner, 2, (last.created, last.id))
    index = "jobs_by_age" if owner else "jobs_by_time"
    assert [len(plan.splitlines()) for plan in found] == [1, 1, 1]  # none a sort
    assert all(f"USING INDEX {index}" in plan for plan in found)

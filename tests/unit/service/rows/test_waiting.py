from __future__ import annotations

import pytest
import sqlalchemy as sa

from service.rows import attempts, jobs, waiting
from service.rows.states import State
from tests.plans import plans
from tests.unit.service.asking import stored
from tests.unit.service.job_rows import added, claimed


def test_places_in_the_queue_count_from_one_and_skip_what_runs(engine: sa.Engine) -> None:
    queue = [added(engine, job_id) for job_id in "abcd"]
    assert [job.rank for job in queue] == [4, 8, 12, 16]
    claimed(engine, queue[0].id, "w1")
    with engine.connect() as connection:
        places = waiting.positions(connection, [stored(engine, job.id) for job in queue])
        assert waiting.count_queued(connection) == waiting.count_queued(connection, "") == 3
        assert waiting.count_queued(connection, "another") == 0
    assert places == {queue[1].id: 1, queue[2].id: 2, queue[3].id: 3}


def test_a_place_in_the_queue_is_that_of_the_rank(engine: sa.Engine) -> None:
    names = {"a": "one", "b": "one", "c": "one", "d": "another"}
    queue = [added(engine, job_id, owner=owner) for job_id, owner in names.items()]
    with engine.connect() as connection:
        places = waiting.positions(connection, queue)
    assert places == {"a": 1, "d": 2, "b": 3, "c": 4}


def test_the_places_of_a_queue_are_told_by_one_query_by_its_index(engine: sa.Engine) -> None:
    queue = [added(engine, job_id) for job_id in "abc"]
    captures = [added(engine, job_id, camera="studio", capture={}) for job_id in "de"]
    with engine.connect() as connection, plans(engine) as found:
        places = waiting.positions(connection, [*queue, *captures])
    assert places == {"a": 1, "b": 2, "c": 3, "d": 1, "e": 2}
    assert len(found) == 2
    assert all("USING INDEX jobs_by_rank" in plan for plan in found)
    assert not any("TEMP B-TREE" in plan for plan in found)


def test_the_place_of_one_job_is_counted_by_the_index(engine: sa.Engine) -> None:
    queue = [added(engine, job_id) for job_id in "abc"]
    capture = [added(engine, job_id, camera="studio", capture={}) for job_id in "de"][1]
    with engine.connect() as connection:
        for place, job in enumerate(queue, 1):
            assert waiting.positions(connection, [job]) == {job.id: place}
        with plans(engine) as found:
            places = waiting.positions(connection, [queue[2], capture])
    assert places == {"c": 3, "e": 2}
    assert all("INDEX jobs_by_rank" in plan and "TEMP" not in plan for plan in found)


def test_a_job_that_was_begun_since_it_was_read_has_the_place_that_it_had(
    engine: sa.Engine,
) -> None:
    first, second = (added(engine, job_id) for job_id in "ab")
    claimed(engine, first.id, "w1")
    with engine.connect() as connection:
        assert waiting.positions(connection, [first, second]) == {first.id: 1, second.id: 1}
        assert waiting.positions(connection, [first]) == {first.id: 1}


def test_late_is_what_waits_past_its_deadline(engine: sa.Engine) -> None:
    added(engine, "early", deadline=9e9)
    added(engine, "late", deadline=1.0)
    added(engine, "endless")
    added(engine, "running", deadline=1.0)
    held = claimed(engine, "running", "w1")
    with engine.begin() as connection:
        assert waiting.overdue(connection, 10) == [("late", "t")]
        assert attempts.is_late(connection, held)
        assert not attempts.is_late(connection, stored(engine, "early"))
        assert not attempts.is_late(connection, stored(engine, "endless"))
        assert jobs.fail_waiting(connection, "late", {"detail": "too late"}, 10)
        assert waiting.overdue(connection, 10) == []
        assert not jobs.fail_waiting(connection, "running", {})
    job = stored(engine, "late")
    assert (job.state, job.error) == (State.FAILED, {"detail": "too late"})
    assert job.finished is not None and job.expires == pytest.approx(job.finished + 10, abs=0.1)


def test_the_first_that_are_late_come_first_and_by_their_index(engine: sa.Engine) -> None:
    for job_id, deadline in (("a", 3.0), ("b", 1.0), ("c", 2.0)):
        added(engine, job_id, deadline=deadline)
    with engine.connect() as connection, plans(engine) as found:
        assert waiting.overdue(connection, 2) == [("b", "t"), ("c", "t")]
    (plan,) = found
    assert "USING INDEX jobs_by_deadline" in plan
    assert "TEMP B-TREE" not in plan

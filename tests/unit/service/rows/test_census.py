from __future__ import annotations

from typing import Any

import pytest
import sqlalchemy as sa

from service.rows import census, clock, heartbeats, jobs, tables


def _add(connection: sa.Connection, job_id: str, ago: float, **values: Any) -> None:
    """Put a job that came so many seconds ago into the queue."""
    row = {"id": job_id, "options": {}, "trace_id": "1" * 32, "request_hash": ""}
    jobs.add(connection, row)
    more = {"created": clock.now() - ago, **values}
    connection.execute(sa.update(tables.jobs).where(tables.jobs.c.id == job_id).values(more))


def test_what_waits_for_a_camera_does_not_wait_for_a_worker(engine: sa.Engine) -> None:
    with engine.begin() as connection:
        _add(connection, "for its hour", 9000, camera="studio", capture={})
        assert census.longest_wait(connection) == 0
        _add(connection, "for a worker", 100)
        assert census.longest_wait(connection) == pytest.approx(100, abs=50)


def test_a_pair_that_was_taken_waits_from_then_on(engine: sa.Engine) -> None:
    taken = {"camera": "studio", "capture": {}, "inputs": {}, "started": clock.now() - 100}
    with engine.begin() as connection:
        _add(connection, "a", 9000, **taken)
        assert census.longest_wait(connection) == pytest.approx(100, abs=50)


def test_an_attempt_that_was_cut_short_does_not_shorten_the_wait(engine: sa.Engine) -> None:
    with engine.begin() as connection:
        _add(connection, "a", 9000, started=clock.now() - 100)
        assert census.longest_wait(connection) == pytest.approx(9000, abs=50)


def test_a_worker_that_died_before_the_clock_was_set_back_does_not_live_until_it_is_as_late_again(
    engine: sa.Engine,
) -> None:
    def living(later: float) -> int:
        with engine.begin() as connection:
            connection.execute(sa.update(tables.workers).values(seen=clock.now() + later))
            return census.living_workers(connection, 15)

    with engine.begin() as connection:
        heartbeats.beat(connection, "w")
    assert [living(later) for later in (-100, -5, 5, 3600)] == [0, 1, 1, 0]

from __future__ import annotations

import sqlalchemy as sa

from service.rows import heartbeats, tables


def test_workers_live_on_the_host_that_their_id_begins_with(engine: sa.Engine) -> None:
    with engine.begin() as connection:
        heartbeats.beat(connection, "studio-b-123-0a1b2c3d")
        hosts = ("studio-b", "studio", "studio-b-123")
        assert [heartbeats.live_on(connection, host) for host in hosts] == [True, False, False]


def test_a_silent_worker_is_dead_and_forgotten(engine: sa.Engine) -> None:
    with engine.begin() as connection:
        heartbeats.beat(connection, "w1")
        heartbeats.beat(connection, "w2")
        connection.execute(
            sa.update(tables.workers)
            .where(tables.workers.c.id == "w1")
            .values(seen=tables.workers.c.seen - 100)
        )
        assert heartbeats.living(connection, 15) == {"w2"}
        connection.execute(sa.update(tables.workers).values(seen=tables.workers.c.seen - 100))
        heartbeats.beat(connection, "w2")
        assert heartbeats.living(connection, 15) == {"w2"}


def test_a_worker_that_died_before_the_clock_was_set_back_is_dead_in_time(
    engine: sa.Engine,
) -> None:
    seen = tables.workers.c.seen
    with engine.begin() as connection:
        heartbeats.beat(connection, "w1")
        connection.execute(sa.update(tables.workers).values(seen=seen + 3600))
        assert heartbeats.living(connection, 15) == {"w1"}  # it may live, and beat in a moment
        connection.execute(sa.update(tables.workers).values(seen=seen - 16))
        assert heartbeats.living(connection, 15) == set()

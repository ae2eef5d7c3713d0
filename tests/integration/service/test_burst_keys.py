"""Removals of a burst's jobs at once, on both databases."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor

from service import migrations
from service.rows import bursts, database, expiry, jobs


def test_a_key_is_handed_on_past_a_job_that_is_being_removed(url: str) -> None:
    engine = database.connect(url)
    migrations.upgrade(engine)
    first, second, third = ids = bursts.new_ids(3)
    with engine.begin() as connection:
        for job_id in ids:
            row = {"id": job_id, "options": {}, "trace_id": "1" * 32, "request_hash": ""}
            jobs.add(connection, row | {"idempotency_key": "once" if job_id == first else None})

    def remove(job_id: str) -> None:
        with engine.begin() as connection:
            expiry.remove(connection, job_id)

    with ThreadPoolExecutor(1) as pool, engine.connect() as connection:
        expiry.remove(connection, second)
        removing = pool.submit(remove, first)
        time.sleep(0.5)  # by then it waits for the one above
        assert not removing.done()
        connection.commit()
        removing.result(30)

    with engine.connect() as connection:
        heir = jobs.find_by_key(connection, "", "once")
    assert heir and heir.id == third
    engine.dispose()

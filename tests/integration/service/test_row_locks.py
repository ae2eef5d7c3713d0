"""Transactions that come at once and change the same rows, on both databases."""

from __future__ import annotations

import time
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import pytest
import sqlalchemy as sa

from service import migrations
from service.errors import StoredQuotaError
from service.rows import attempts, bursts, database, expiry, heartbeats, jobs, keys, quotas, uploads
from service.rows.states import State

_SOON_SECONDS = 0.5


@pytest.fixture
def engine(url: str) -> Iterator[sa.Engine]:
    engine = database.connect(url)
    migrations.upgrade(engine)
    yield engine
    engine.dispose()


def _add(engine: sa.Engine, job_id: str, **more: Any) -> None:
    row = {"id": job_id, "options": {}, "trace_id": "1" * 32, "request_hash": ""}
    with engine.begin() as connection:
        jobs.add(connection, row | more)


def _waits(begun: Future[Any]) -> bool:
    time.sleep(_SOON_SECONDS)
    return not begun.done()


def test_a_key_is_handed_on_past_a_job_that_is_being_removed(engine: sa.Engine) -> None:
    first, second, third = ids = bursts.new_ids(3)
    for job_id in ids:
        _add(engine, job_id, idempotency_key="once" if job_id == first else None)

    def remove(job_id: str) -> None:
        with engine.begin() as connection:
            expiry.remove(connection, job_id)

    with ThreadPoolExecutor(1) as pool, engine.connect() as connection:
        expiry.remove(connection, second)
        removing = pool.submit(remove, first)
        assert _waits(removing)
        connection.commit()
        removing.result(30)

    with engine.connect() as connection:
        heir = jobs.find_by_key(connection, "", "once")
    assert heir and heir.id == third


def test_a_job_that_is_put_back_while_it_is_canceled_does_not_slip_through(
    engine: sa.Engine,
) -> None:
    """It is queued no more when that is looked at, and not yet when it is asked to stop."""
    _add(engine, "a")
    with engine.begin() as connection:
        heartbeats.beat(connection, "w")
        held = attempts.claim(connection, "a", "w")
    assert held

    def put_back() -> bool:
        with engine.begin() as connection:
            return attempts.release(connection, held)

    with ThreadPoolExecutor(1) as pool:
        moves: list[Future[bool]] = []

        def between(_c: object, _cursor: object, statement: str, *_more: object) -> None:
            if statement.startswith("UPDATE") and not moves:  # the first of the two moves
                moves.append(pool.submit(put_back))
                time.sleep(_SOON_SECONDS)

        with engine.connect() as connection:
            sa.event.listen(connection, "after_cursor_execute", between)
            jobs.request_cancel(connection, "a")
            connection.commit()
        assert moves[0].result(30) is False

    with engine.connect() as connection:
        found = jobs.find(connection, "a")
    assert found and found.state == State.CANCELING


def test_of_uploads_that_are_begun_at_once_no_more_are_taken_than_fit(engine: sa.Engine) -> None:
    with engine.begin() as connection:
        text = keys.create(connection, "k", [], keys.Quotas(stored_bytes=10), None)
    owner = keys.id_of(text)

    def begin(upload_id: str) -> None:
        with engine.begin() as connection:
            _begin(connection, owner, upload_id)

    with ThreadPoolExecutor(1) as pool, engine.connect() as connection:
        _begin(connection, owner, "a")
        other = pool.submit(begin, "b")
        assert _waits(other)
        connection.commit()
        with pytest.raises(StoredQuotaError):
            other.result(30)


def _begin(connection: sa.Connection, owner: str, upload_id: str) -> None:
    values = {"id": upload_id, "owner": owner, "length": 6}
    uploads.add(connection, values, 3600)
    quotas.charge_upload(connection, owner)

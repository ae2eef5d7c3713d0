from __future__ import annotations

import pytest
import sqlalchemy as sa

from service.rows import bursts, expiry, jobs


def _add(connection: sa.Connection, ids: list[str], key: str) -> None:
    for job_id in ids:
        row = {"id": job_id, "options": {}, "trace_id": "1" * 32, "request_hash": ""}
        jobs.add(connection, row | {"idempotency_key": key if job_id == ids[0] else None})


def _bearer(connection: sa.Connection, key: str) -> str | None:
    found = jobs.find_by_key(connection, "", key)
    return found.id if found else None


def test_ids_of_a_burst_are_in_order_and_no_others() -> None:
    ids = bursts.new_ids(1000)
    assert ids == sorted(set(ids))
    assert {len(job_id) for job_id in ids} == {32}
    assert not set(ids) & set(bursts.new_ids(1000))


@pytest.mark.parametrize("gone", [(0, 1, 2), (1, 0, 2), (2, 0, 1)])
def test_the_key_stays_with_the_burst_until_all_of_it_is_gone(
    gone: tuple[int, ...], engine: sa.Engine
) -> None:
    ids, others = bursts.new_ids(3), bursts.new_ids(2)
    left = list(ids)
    with engine.begin() as connection:
        _add(connection, ids, "key")
        _add(connection, others, "other")
        for number in gone:
            assert bursts.kept(connection, ids[1]) == left
            assert _bearer(connection, "key") == left[0]
            expiry.remove(connection, ids[number])
            left.remove(ids[number])
        assert bursts.kept(connection, ids[1]) == []
        assert _bearer(connection, "key") is None
        assert (bursts.kept(connection, others[1]), _bearer(connection, "other")) == (
            others,
            others[0],
        )

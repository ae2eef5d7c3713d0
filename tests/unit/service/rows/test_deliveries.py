from __future__ import annotations

from typing import Any

import pytest
import sqlalchemy as sa

from service.rows import deliveries, jobs


def _delivery(state: str, attempts: int) -> dict[str, Any]:
    return {"state": state, "attempts": attempts, "last_status": None}


@pytest.mark.parametrize(
    ("earlier", "later", "written"),
    [
        (None, ("pending", 0), True),
        (("pending", 0), ("pending", 0), False),
        (("pending", 0), ("delivered", 1), True),
        (("pending", 1), ("pending", 2), True),
        (("pending", 2), ("pending", 1), False),
        (("delivered", 1), ("pending", 0), False),
        (("delivered", 1), ("failed", 2), False),
        (("failed", 1), ("delivered", 2), False),
    ],
)
def test_what_came_of_an_attempt_is_never_taken_back(
    earlier: tuple[str, int] | None, later: tuple[str, int], written: bool, engine: sa.Engine
) -> None:
    row = {"id": "a", "options": {}, "trace_id": "1" * 32, "request_hash": ""}
    with engine.begin() as connection:
        jobs.add(connection, row | {"delivery": earlier and _delivery(*earlier)})
        before = jobs.find(connection, "a")
        assert deliveries.write(connection, "a", _delivery(*later)) == written
        after = jobs.find(connection, "a")
    assert before is not None and after is not None
    kept = later if written else earlier
    assert after.delivery == (kept and _delivery(*kept))
    assert after.revision == before.revision + written


def test_nothing_is_written_of_a_job_that_is_gone(engine: sa.Engine) -> None:
    with engine.begin() as connection:
        assert not deliveries.write(connection, "gone", _delivery("pending", 0))


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ({}, True),
        ({"expires": 9e9}, True),
        ({"expires": 50.0}, False),  # it was deleted before it ended
        ({"state": "expired", "expires": 60.0}, False),
        ({"finished": None}, False),
        ({"delivery": _delivery("pending", 0)}, False),
        ({"webhook": None}, False),
    ],
)
def test_a_webhook_is_told_of_an_end_that_nobody_has_deleted(
    values: dict[str, Any], told: bool, engine: sa.Engine
) -> None:
    row = {"id": "a", "options": {}, "trace_id": "1" * 32, "request_hash": ""}
    ended = {"state": "failed", "finished": 50.0, "webhook": {"url": "u"}}
    with engine.begin() as connection:
        jobs.add(connection, row | ended | values)
        assert deliveries.due(connection, 10) == (["a"] if told else [])

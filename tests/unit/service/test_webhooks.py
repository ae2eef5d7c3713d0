from __future__ import annotations

import json
import logging
import random
import time
from collections.abc import Callable
from typing import Any

import pytest
import sqlalchemy as sa
from standardwebhooks import Webhook

from service import webhooks
from service.api.context import Context
from service.outgoing import Answer, UnansweredError
from service.rows import attempts, deliveries, expiry, jobs
from service.rows.states import State
from service.settings import Settings
from service.webhooks import Deliverer, queue_deliveries
from tests.unit.service.asking import stored
from tests.unit.service.at_first import raising
from tests.unit.service.receiver import SECRET, receiving

URL = "https://hook.example/?token=hidden"
OPTIONS = {"lights": 2, "flash_spectrum": {"power": [1.0] * 500}}


class FakeQueue:
    """Takes down what is to be delivered, and when."""

    def __init__(self) -> None:
        self.queued: list[tuple[str, int, float]] = []

    def submit_delivery(
        self, _connection: sa.Connection, job_id: str, number: int, delay_seconds: float
    ) -> None:
        self.queued.append((job_id, number, delay_seconds))


@pytest.fixture
def queue() -> FakeQueue:
    return FakeQueue()


def _add(engine: sa.Engine, job_id: str, url: str | None = URL) -> None:
    values: dict[str, Any] = {
        "id": job_id,
        "options": OPTIONS,
        "trace_id": "1" * 32,
        "request_hash": "",
        "webhook": url and {"url": url, "secret": SECRET},
    }
    with engine.begin() as connection:
        jobs.add(connection, values)


def _ended(engine: sa.Engine, job_id: str, url: str | None = URL) -> None:
    _add(engine, job_id, url)
    with engine.begin() as connection:
        held = attempts.claim(connection, job_id, "w1")
        assert held is not None
        assert attempts.succeed(connection, held, [])


def _begun(engine: sa.Engine, queue: Any) -> int:
    with engine.begin() as connection:
        return queue_deliveries(connection, queue)


ENDS: dict[State, Callable[[sa.Connection, jobs.Job], object]] = {
    State.SUCCEEDED: lambda connection, held: attempts.succeed(connection, held, []),
    State.FAILED: lambda connection, held: attempts.fail(connection, held, {}),
    State.CANCELED: attempts.acknowledge_cancel,
}


@pytest.mark.parametrize("end", ENDS)
def test_every_end_is_delivered_once(end: State, engine: sa.Engine, queue: FakeQueue) -> None:
    _add(engine, "a")
    with engine.begin() as connection:
        held = attempts.claim(connection, "a", "w1")
        assert held is not None
        if end == State.CANCELED:
            jobs.request_cancel(connection, "a")
    assert _begun(engine, queue) == 0
    with engine.begin() as connection:
        ENDS[end](connection, held)
    assert _begun(engine, queue) == 1
    assert _begun(engine, queue) == 0
    assert queue.queued == [("a", 1, 0.0)]
    assert stored(engine, "a").delivery == {"state": "pending", "attempts": 0, "last_status": None}


def test_a_job_canceled_while_it_waits_is_due(engine: sa.Engine, queue: FakeQueue) -> None:
    _add(engine, "a")
    with engine.begin() as connection:
        jobs.request_cancel(connection, "a")
    assert _begun(engine, queue) == 1


@pytest.mark.parametrize(
    ("error", "cause"),
    [
        (sa.exc.OperationalError("", None, Exception("away")), "away"),
        (sa.exc.TimeoutError("busy"), "busy"),
    ],
)
def test_a_delivery_outlasts_a_database_that_is_away_or_busy(
    error: Exception,
    cause: str,
    engine: sa.Engine,
    queue: Any,
    settings: Settings,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    """Raised to the queue, it would be the last one. The log has a line of it, not one a try."""
    errors, find = [error, error], jobs.find
    _ended(engine, "a")
    _begun(engine, queue)

    def at_first(connection: sa.Connection, job_id: str) -> jobs.Job | None:
        if errors:
            raise errors.pop()
        return find(connection, job_id)

    monkeypatch.setattr(jobs, "find", at_first)
    monkeypatch.setattr(webhooks, "_RETRY_SECONDS", 0.0)
    monkeypatch.setattr(webhooks, "post", lambda *_arguments: Answer(204, ""))
    with caplog.at_level(logging.WARNING):
        Deliverer(engine, queue, settings).deliver("a", 1)
    delivery = stored(engine, "a").delivery
    assert delivery == {"state": "delivered", "attempts": 1, "last_status": 204}
    assert [(line.getMessage(), line.exc_info) for line in caplog.records] == [
        (f"the delivery to a webhook is hindered, database-unavailable: {cause}", None)
    ]


def test_an_end_that_was_rolled_back_is_not_delivered(engine: sa.Engine, queue: FakeQueue) -> None:
    _add(engine, "a")
    with engine.connect() as connection:
        held = attempts.claim(connection, "a", "w1")
        assert held is not None
        assert attempts.succeed(connection, held, [])
        connection.rollback()
    assert _begun(engine, queue) == 0
    assert stored(engine, "a").state == State.QUEUED


def test_what_another_worker_has_delivered_meanwhile_stays_delivered(
    engine: sa.Engine, queue: FakeQueue, monkeypatch: pytest.MonkeyPatch
) -> None:
    """SQLite holds no rows for who reads them."""
    _ended(engine, "a")
    told = {"state": "delivered", "attempts": 1, "last_status": 204}
    due = deliveries.due

    def stall(connection: sa.Connection, limit: int) -> list[str]:
        found = due(connection, limit)
        with engine.begin() as other:
            assert deliveries.write(other, "a", told)
        return found

    monkeypatch.setattr(deliveries, "due", stall)
    assert _begun(engine, queue) == 0
    assert queue.queued == []
    assert stored(engine, "a").delivery == told


def test_without_a_webhook_nothing_is_queued(engine: sa.Engine, queue: FakeQueue) -> None:
    _ended(engine, "a", None)
    assert _begun(engine, queue) == 0
    assert stored(engine, "a").delivery is None


def test_what_is_due_is_found_by_its_index(engine: sa.Engine) -> None:
    with engine.connect() as connection:
        query = (
            "EXPLAIN QUERY PLAN SELECT id FROM jobs WHERE webhook IS NOT NULL AND delivery IS NULL "
            "AND finished > 0"
        )
        plan = " ".join(row[3] for row in connection.exec_driver_sql(query))
    assert "USING INDEX jobs_with_news" in plan


def _deliver(engine: sa.Engine, queue: Any, number: int = 1, **settings: Any) -> dict[str, Any]:
    usual = {"webhook_private": "127.0.0.0/8", "webhook_seconds": 60}
    Deliverer(engine, queue, Settings(**{**usual, **settings})).deliver("a", number)
    delivery = stored(engine, "a").delivery
    assert delivery is not None
    return delivery


def _answers(monkeypatch: pytest.MonkeyPatch, status: int, after: str = "") -> None:
    monkeypatch.setattr(webhooks, "post", lambda *_arguments: Answer(status, after))


def test_an_event_bears_the_job_and_no_secret(
    engine: sa.Engine, queue: FakeQueue, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO")
    with receiving(204) as receiver:
        _ended(engine, "a", receiver.url)
        _begun(engine, queue)
        assert _deliver(engine, queue) == {"state": "delivered", "attempts": 1, "last_status": 204}
        told = receiver.next()
    assert told.path == "/hook?token=hidden"
    assert told.headers["webhook-id"] == "job_a"
    assert told.headers["content-type"] == "application/json"
    assert set(told.event) == {"type", "timestamp", "data"}
    assert (told.event["type"], told.event["data"]["state"]) == ("job.succeeded", "succeeded")
    assert told.event["timestamp"] == told.event["data"]["finished"]
    assert told.event["data"]["options"] == {"lights": 2}  # the table would be most of it
    for text in (json.dumps(told.event), caplog.text):
        assert SECRET not in text and "hidden" not in text
    assert "webhook answered 204" in caplog.text
    assert queue.queued == [("a", 1, 0.0)]


def test_a_fault_of_the_service_is_followed_by_another_attempt(
    engine: sa.Engine,
    queue: FakeQueue,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    def break_down(*_arguments: object) -> Answer:
        raise ZeroDivisionError

    _ended(engine, "a")
    _begun(engine, queue)
    monkeypatch.setattr(webhooks, "post", break_down)
    assert _deliver(engine, queue) == {"state": "pending", "attempts": 1, "last_status": None}
    assert [entry[:2] for entry in queue.queued] == [("a", 1), ("a", 2)]
    (line,) = caplog.records
    assert (line.getMessage(), line.exc_info is not None) == ("webhook not delivered", True)


def test_the_id_stays_and_the_signature_is_of_the_moment(
    engine: sa.Engine, queue: FakeQueue, monkeypatch: pytest.MonkeyPatch
) -> None:
    _ended(engine, "a")
    _begun(engine, queue)
    seen: list[dict[str, str]] = []

    def take(url: str, headers: dict[str, str], body: bytes, *_rest: object) -> Answer:
        assert url == URL
        assert Webhook(SECRET).verify(body, headers)["data"]["id"] == "a"
        seen.append(headers)
        return Answer(500, "")

    monkeypatch.setattr(webhooks, "post", take)
    for number in (1, 2):
        _deliver(engine, queue, number)
    assert [headers["webhook-id"] for headers in seen] == ["job_a", "job_a"]


@pytest.mark.parametrize("status", [199, 301, 307, 400, 404, 429, 500, 503])
def test_what_is_no_success_is_told_again(
    status: int, engine: sa.Engine, queue: FakeQueue, monkeypatch: pytest.MonkeyPatch
) -> None:
    _ended(engine, "a")
    _begun(engine, queue)
    _answers(monkeypatch, status)
    assert _deliver(engine, queue) == {"state": "pending", "attempts": 1, "last_status": status}
    assert queue.queued[1][:2] == ("a", 2)


def test_no_answer_is_told_again(
    engine: sa.Engine, queue: FakeQueue, monkeypatch: pytest.MonkeyPatch
) -> None:
    _ended(engine, "a")
    _begun(engine, queue)
    monkeypatch.setattr(webhooks, "post", raising(UnansweredError("it took too long")))
    assert _deliver(engine, queue) == {"state": "pending", "attempts": 1, "last_status": None}


def test_a_fault_of_ours_does_not_lose_the_delivery(
    engine: sa.Engine,
    queue: FakeQueue,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    _ended(engine, "a")
    _begun(engine, queue)
    monkeypatch.setattr(webhooks, "post", lambda *_arguments: 1 / 0)
    assert _deliver(engine, queue)["state"] == "pending"
    assert "ZeroDivisionError" in caplog.text and SECRET not in caplog.text


@pytest.mark.parametrize(("status", "tries"), [(410, 12), (500, 1)])
def test_some_ends_are_for_good(
    status: int,
    tries: int,
    engine: sa.Engine,
    queue: FakeQueue,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    _ended(engine, "a")
    _begun(engine, queue)
    _answers(monkeypatch, status)
    delivery = _deliver(engine, queue, webhook_tries=tries)
    assert delivery == {"state": "failed", "attempts": 1, "last_status": status}
    assert len(queue.queued) == 1


def test_a_second_copy_of_an_attempt_does_nothing(
    engine: sa.Engine, queue: FakeQueue, monkeypatch: pytest.MonkeyPatch
) -> None:
    _ended(engine, "a")
    _begun(engine, queue)
    _answers(monkeypatch, 500)
    first = _deliver(engine, queue)
    _answers(monkeypatch, 204)
    assert _deliver(engine, queue, 1) == first
    assert _deliver(engine, queue, 2)["state"] == "delivered"
    _answers(monkeypatch, 500)
    assert _deliver(engine, queue, 3)["state"] == "delivered"


def test_a_copy_of_an_attempt_that_ends_late_takes_nothing_back(
    engine: sa.Engine, queue: FakeQueue, monkeypatch: pytest.MonkeyPatch
) -> None:
    _ended(engine, "a")
    _begun(engine, queue)
    told = {"state": "delivered", "attempts": 1, "last_status": 204}

    def stall(*_arguments: object) -> Answer:
        with engine.begin() as other:
            assert deliveries.write(other, "a", told)
        return Answer(500, "")

    monkeypatch.setattr(webhooks, "post", stall)
    assert _deliver(engine, queue) == told
    assert len(queue.queued) == 1


def test_a_deleted_job_is_not_told(engine: sa.Engine, queue: Any) -> None:
    Deliverer(engine, queue, Settings()).deliver("gone", 1)
    assert queue.queued == []


@pytest.mark.parametrize("moment", ["it waits", "it runs", "it has ended"])
def test_a_job_whose_removal_hangs_is_not_delivered(
    moment: str, engine: sa.Engine, queue: FakeQueue
) -> None:
    (_ended if moment == "it has ended" else _add)(engine, "a")
    with engine.begin() as connection:
        held = attempts.claim(connection, "a", "w1") if moment == "it runs" else None
        jobs.request_cancel(connection, "a")
        expiry.condemn(connection, "a")
    if held:
        with engine.begin() as connection:
            assert attempts.acknowledge_cancel(connection, held, 86400)
    assert stored(engine, "a").finished
    assert _begun(engine, queue) == 0


def test_a_job_that_is_kept_for_a_time_is_due(engine: sa.Engine, queue: FakeQueue) -> None:
    _add(engine, "a")
    with engine.begin() as connection:
        held = attempts.claim(connection, "a", "w1")
        assert held is not None
        assert attempts.succeed(connection, held, [], keep_seconds=0.001)
    time.sleep(0.01)
    assert _begun(engine, queue) == 1


def test_a_job_that_is_deleted_between_two_attempts_is_not_tried_again(
    engine: sa.Engine, queue: FakeQueue, monkeypatch: pytest.MonkeyPatch
) -> None:
    _ended(engine, "a")
    assert _begun(engine, queue) == 1
    with engine.begin() as connection:
        expiry.condemn(connection, "a")
    monkeypatch.setattr(webhooks, "post", lambda *_arguments: pytest.fail("it was told"))
    assert _deliver(engine, queue) == {"state": "pending", "attempts": 0, "last_status": None}
    assert stored(engine, "a").state == State.EXPIRED
    assert len(queue.queued) == 1


@pytest.mark.parametrize("since", [{"webhook_private": "false"}, {"webhook_https": True}])
def test_what_settings_forbid_since_the_job_was_asked_for_is_not_told(
    engine: sa.Engine, queue: FakeQueue, since: dict[str, Any]
) -> None:
    with receiving(204) as receiver:
        _ended(engine, "a", receiver.url)
        _begun(engine, queue)
        delivery = _deliver(engine, queue, **since)
        assert receiver.told.empty()
    assert delivery == {"state": "pending", "attempts": 1, "last_status": None}


def test_pauses_grow_to_about_a_day(
    engine: sa.Engine, queue: FakeQueue, monkeypatch: pytest.MonkeyPatch
) -> None:
    _ended(engine, "a")
    _begun(engine, queue)
    _answers(monkeypatch, 500)
    monkeypatch.setattr(random, "uniform", lambda low, high: (low + high) / 2)
    for number in range(1, 13):
        delivery = _deliver(engine, queue, number)
    assert delivery == {"state": "failed", "attempts": 12, "last_status": 500}
    pauses = [delay for _, _, delay in queue.queued[1:]]
    assert pauses[:3] == pytest.approx([5, 12.5, 31.25])
    assert sum(pauses) / 3600 == pytest.approx(22, abs=1)


@pytest.mark.parametrize(
    ("status", "header", "low", "high"),
    [
        (429, "600", 600, 600),
        (503, "600", 600, 600),
        (500, "600", 4, 6),
        (503, "1", 4, 6),
        (503, "soon", 4, 6),
        (503, "999999999999", 86400, 86400),
        (503, "Fri, 31 Dec 9999 23:59:59 -2359", 86400, 86400),
    ],
)
def test_a_receiver_may_ask_for_a_pause(
    status: int,
    header: str,
    low: float,
    high: float,
    engine: sa.Engine,
    queue: FakeQueue,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    _ended(engine, "a")
    _begun(engine, queue)
    _answers(monkeypatch, status, header)
    _deliver(engine, queue)
    assert low <= queue.queued[1][2] <= high


def test_the_queue_takes_an_attempt_once(context: Context) -> None:
    with context.engine.begin() as connection:
        for _ in range(2):
            context.queue.submit_delivery(connection, "a", 1, 0.0)
        context.queue.submit_delivery(connection, "a", 2, 3600.0)
    assert _workflows(context) == {"a-webhook-1": "ENQUEUED", "a-webhook-2": "DELAYED"}


def _workflows(context: Context) -> dict[str, str]:
    with context.engine.connect() as connection:
        rows = connection.exec_driver_sql("SELECT workflow_uuid, status FROM workflow_status")
        return {row[0]: row[1] for row in rows}

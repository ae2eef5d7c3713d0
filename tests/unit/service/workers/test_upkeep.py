"""What heartbeats and sweeps do."""

from __future__ import annotations

import sqlite3
import threading
from typing import Any

import pytest
import sqlalchemy as sa
from obstore.exceptions import GenericError

from service import counters
from service.dbos_queue import entries
from service.dbos_queue.entries import Held
from service.errors import StartError
from service.rows import attempts, heartbeats, jobs, tables
from service.rows.database import AWAY
from service.rows.states import State
from service.storage.base import Storage
from service.storage.folder import FolderStorage
from service.workers import host, presence, upkeep
from service.workers.worker import Worker
from tests.unit.service.at_first import at_first, raising
from tests.unit.service.full_disk import full_disk
from tests.unit.service.job_rows import added, added_pair, claim, claimed

_AWAY = sa.exc.OperationalError("SELECT 1", {}, Exception("connection failed: refused\nDETAIL: x"))


def _state(one: Worker) -> State:
    with one._engine.connect() as connection:
        job = jobs.find(connection, "a")
    assert job is not None
    return job.state


def test_what_the_queues_forgot_to_bring_is_put_back(
    one: Worker, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A sweep of which the answer got lost would hold up all others, a delivery be lost."""
    put_back: list[set[str]] = []
    held = [
        Held("mine", one.id, "jobs"),
        Held("running-again-1", one.id, "jobs"),
        Held("an attempt", one.id, "webhooks"),
        Held("a sweep", one.id, "upkeep"),
        Held("dead", "another", "jobs"),
        Held("living", "neighbour", "jobs"),
    ]

    def look() -> list[Held]:
        with one._engine.begin() as connection:
            heartbeats.beat(connection, "neighbour")  # which may just have come
        return held

    monkeypatch.setattr(one._queue, "held", look)
    monkeypatch.setattr(
        one._queue, "put_back", lambda found: put_back.append({held.id for held in found})
    )
    with one._in_hand.alone("running"):
        one.upkeep.keep()
        one.upkeep.keep()
    assert put_back == [{"dead"}, {"dead", "mine", "an attempt", "a sweep"}]


def test_what_is_taken_over_is_logged_as_its_job_and_counted_if_it_is_one(
    one: Worker, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    for job in ("a", "b"):
        added(one._engine, job)
        assert claim(one._engine, job, "another")
    held = [
        Held("a", "another", "jobs"),
        Held(entries.capture_id("b"), "another", entries.captures_on("host")),
        Held(entries.delivery_id("c", 12), "another", "webhooks"),
        Held("sched-often-1", "another", "upkeep"),
    ]
    monkeypatch.setattr(one._queue, "held", lambda: held)
    monkeypatch.setattr(one._queue, "put_back", lambda _found: None)
    before = counters.TAKEOVERS._value.get()
    one.upkeep.keep()
    logged = {vars(line)["job"] for line in caplog.records if line.message == "taken over"}
    assert logged == {"a", "b", "c", "sched-often-1"}
    assert counters.TAKEOVERS._value.get() - before == 2


def test_what_a_stopped_worker_has_put_back_is_not_counted_as_taken_over(
    one: Worker, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Its rows wait again, and nothing but its entries in the queue tells that it had them."""
    caplog.set_level("WARNING")
    for job in ("lost", "released", "canceling", "never begun", "ended"):
        added(one._engine, job)
        if job != "never begun":
            row = claimed(one._engine, job, "another")
            with one._engine.begin() as connection:
                if job == "released":
                    assert attempts.release(connection, row)
                if job == "canceling":
                    jobs.request_cancel(connection, job)
                if job == "ended":
                    assert attempts.fail(connection, row, {})
    with one._engine.begin() as connection:
        heartbeats.leave(connection, "another")
    held = [
        Held(entries.run_id(job, again), "another", "jobs")
        for again, job in enumerate(["lost", "released", "canceling", "never begun", "ended"])
    ]
    put_back: list[set[Held]] = []
    monkeypatch.setattr(one._queue, "held", lambda: held)
    monkeypatch.setattr(one._queue, "put_back", put_back.append)
    before = counters.TAKEOVERS._value.get()
    one.upkeep.keep()
    assert put_back == [set(held)]
    assert {(line.message, vars(line)["job"]) for line in caplog.records} == {
        ("taken over", "lost"),
        ("taken over", "canceling"),
        ("put back", "released"),
        ("put back", "never begun"),
        ("put back", "ended"),
    }
    assert counters.TAKEOVERS._value.get() - before == 2


def test_deliveries_and_sweeps_that_take_long_are_not_put_back(
    one: Worker, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun, go = threading.Barrier(3), threading.Event()
    put_back: list[set[Held]] = []
    done: list[tuple[Any, ...]] = []

    def work(*arguments: Any) -> None:
        begun.wait(60)
        assert go.wait(60)
        done.append(arguments)

    monkeypatch.setattr(one._deliverer, "deliver", work)
    monkeypatch.setattr(one.upkeep._sweeping, "run", work)
    held = [Held("a-webhook-2", one.id, "webhooks"), Held("sched-often", one.id, "upkeep")]
    monkeypatch.setattr(one._queue, "held", lambda: held)
    monkeypatch.setattr(one._queue, "put_back", put_back.append)
    threads = [
        threading.Thread(target=one.deliver, args=("a", 2)),
        threading.Thread(target=one.sweep, args=("sched-often", True)),
    ]
    for thread in threads:
        thread.start()
    begun.wait(60)
    one.upkeep.keep()
    one.upkeep.keep()
    go.set()
    for thread in threads:
        thread.join()
    assert put_back == [set(), set()]
    assert sorted(done, key=len) == [(True,), ("a", 2)]


def test_the_jobs_of_a_worker_that_died_on_this_machine_are_taken_over_at_once(
    one: Worker, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its silence is not waited for, as that of a worker elsewhere is."""
    monkeypatch.setattr(presence, "dead", lambda _folder: iter(["died-here"]))
    put_back: list[Held] = []
    held = [Held("a", "died-here", "jobs"), Held("b", "elsewhere", "jobs")]
    monkeypatch.setattr(one._queue, "held", lambda: held)
    monkeypatch.setattr(one._queue, "put_back", put_back.extend)
    with one._engine.begin() as connection:
        for name in ("died-here", "elsewhere"):
            heartbeats.beat(connection, name)
    one.upkeep.keep()
    assert put_back == held[:1]


def test_a_worker_is_known_to_live_on_its_host(one: Worker) -> None:
    one.upkeep._beat()
    with one._engine.connect() as connection:
        assert heartbeats.live_on(connection, host.name())
        assert not heartbeats.live_on(connection, host.name()[:-1])


def test_a_heartbeat_fails_some_of_many_late_jobs_at_once_and_the_next_one_goes_on(
    one: Worker, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(upkeep, "_OVERDUE_AT_ONCE", 2)
    withdrawn: list[tuple[str, ...]] = []
    monkeypatch.setattr(one._queue, "withdraw", lambda *job_ids: withdrawn.append(job_ids))
    for number, job_id in enumerate(("a", "b", "c", "in time")):
        added_pair(one._engine, id=job_id, deadline=9e9 if job_id == "in time" else 1.0 + number)
    for _ in range(3):
        one.upkeep.keep()
    assert withdrawn == [("a", "b"), ("c",)]
    with one._engine.connect() as connection:
        found = {job.id: job.state for job in jobs.page(connection, None, 10)}
    assert found == dict.fromkeys("abc", State.FAILED) | {"in time": State.QUEUED}


def test_late_jobs_fail_in_one_transaction(one: Worker) -> None:
    for job_id in "abc":
        added_pair(one._engine, id=job_id, deadline=1.0)
    writes: list[int] = []

    def count(_c: object, _cursor: object, query: str, *_more: object) -> None:
        if query.startswith("UPDATE jobs"):
            writes.append(len(commits))

    commits: list[None] = []
    sa.event.listen(one._engine, "before_cursor_execute", count)
    sa.event.listen(one._engine, "commit", lambda _connection: commits.append(None))
    one.upkeep.keep()
    assert writes == [writes[0]] * 3


def test_a_heartbeat_outlives_what_breaks_it(
    one: Worker, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def fail() -> list[str]:
        raise RuntimeError("no such workflow")

    with monkeypatch.context() as broken:
        broken.setattr(one._queue, "held", fail)
        one.upkeep.keep()
    assert "no such workflow" in caplog.text
    with one._engine.begin() as connection:
        connection.execute(sa.delete(tables.workers))
    one.upkeep.keep()
    with one._engine.connect() as connection:
        assert connection.execute(sa.select(tables.workers.c.id)).scalars().all() == [one.id]


@pytest.mark.parametrize("error", AWAY)
def test_a_database_that_is_away_does_not_end_a_worker(
    one: Worker, error: type[sa.exc.SQLAlchemyError], monkeypatch: pytest.MonkeyPatch
) -> None:
    gone = error("", None, sqlite3.OperationalError("away"))
    monkeypatch.setattr(heartbeats, "beat", at_first(gone, heartbeats.beat))
    one.upkeep.keep()
    one.upkeep.keep()
    with one._engine.begin() as connection:
        assert heartbeats.living(connection, 60) == {one.id}


@pytest.mark.parametrize("noticed", ["by its heartbeat", "by the sweep", "at its start"])
def test_on_a_full_disk_of_the_database_a_worker_makes_room(noticed: str, one: Worker) -> None:
    """No sweep comes out of its queue then."""
    added_pair(one._engine, state="succeeded", finished=1.0, expires=2.0)
    one._storage.put("jobs/a/inputs/flash", b"light")
    with full_disk(one._engine):
        if noticed == "by its heartbeat":
            one.upkeep.keep()
        elif noticed == "by the sweep":
            one.sweep("s", False)
        else:
            with pytest.raises(StartError, match="cannot be written: make room on its disk"):
                one.upkeep.enter()
        assert one._storage.list("jobs/") == []
        assert _state(one) == State.SUCCEEDED
    one.upkeep.enter()
    one.sweep("s", False)
    with one._engine.connect() as connection:
        assert jobs.find(connection, "a") is None


def test_a_database_that_is_away_makes_no_room(
    one: Worker, monkeypatch: pytest.MonkeyPatch
) -> None:
    added_pair(one._engine, state="succeeded", finished=1.0, expires=2.0)
    one._storage.put("jobs/a/inputs/flash", b"light")
    gone = sa.exc.OperationalError("", None, sqlite3.OperationalError("away"))
    monkeypatch.setattr(heartbeats, "beat", at_first(gone, heartbeats.beat))
    one.upkeep.keep()
    assert len(one._storage.list("")) == 1


def test_a_heartbeat_outlives_room_that_cannot_be_made(
    one: Worker, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def fail(_storage: Storage) -> int:
        raise GenericError("the store is away")

    monkeypatch.setattr(FolderStorage, "free_bytes", fail)
    with full_disk(one._engine):
        one.upkeep.keep()
    assert "making room was cut short, store-unavailable: the store is away" in caplog.text
    assert not any(line.exc_info for line in caplog.records)
    one.upkeep.keep()
    with one._engine.begin() as connection:
        assert heartbeats.living(connection, 60) == {one.id}


@pytest.mark.parametrize(
    ("error", "words", "traced"),
    [
        (_AWAY, "the heartbeat was cut short, database-unavailable: connection failed: refused", 0),
        (RuntimeError("what?"), "the heartbeat was cut short", 1),
    ],
)
def test_a_heartbeat_without_a_database_is_a_line_and_a_fault_of_ours_a_trace(
    error: Exception,
    words: str,
    traced: int,
    one: Worker,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    monkeypatch.setattr(one._queue, "held", raising(error))
    one.upkeep.keep()
    said = [(line.getMessage(), bool(line.exc_info)) for line in caplog.records]
    assert said == [(words, bool(traced))]
    assert vars(caplog.records[0])["worker"] == one.id

"""What heartbeats bring back into the queues."""

from __future__ import annotations

import threading
from typing import Any

import pytest

from service import counters, dbos_queue
from service.dbos_queue import Held
from service.rows import attempts, heartbeats, jobs
from service.workers import presence
from service.workers.worker import Worker
from tests.unit.service.job_rows import added, claim, claimed


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
    one._runs.add("running")
    one.keep()
    one.keep()
    assert put_back == [{"dead"}, {"dead", "mine", "an attempt", "a sweep"}]


def test_what_is_taken_over_is_logged_as_its_job_and_counted_if_it_is_one(
    one: Worker, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    for job in ("a", "b"):
        added(one._engine, job)
        assert claim(one._engine, job, "another")
    held = [
        Held("a", "another", "jobs"),
        Held(dbos_queue.capture_id("b"), "another", dbos_queue.captures_on("host")),
        Held(dbos_queue.delivery_id("c", 12), "another", "webhooks"),
        Held("sched-often-1", "another", "upkeep"),
    ]
    monkeypatch.setattr(one._queue, "held", lambda: held)
    monkeypatch.setattr(one._queue, "put_back", lambda _found: None)
    before = counters.TAKEOVERS._value.get()
    one.keep()
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
        Held(dbos_queue.run_id(job, again), "another", "jobs")
        for again, job in enumerate(["lost", "released", "canceling", "never begun", "ended"])
    ]
    put_back: list[set[Held]] = []
    monkeypatch.setattr(one._queue, "held", lambda: held)
    monkeypatch.setattr(one._queue, "put_back", put_back.append)
    before = counters.TAKEOVERS._value.get()
    one.keep()
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
    monkeypatch.setattr(one._sweeping, "run", work)
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
    one.keep()
    one.keep()
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
    one.keep()
    assert put_back == held[:1]

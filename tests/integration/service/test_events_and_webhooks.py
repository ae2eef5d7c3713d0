"""Events and webhooks of a service of real processes."""

from __future__ import annotations

import os
import signal
import sqlite3
from typing import Any

import drivers
from tests.unit.service.receiver import SECRET, Receiver, receiving
from tests.unit.service.streams import Event, events

Job = dict[str, Any]


def _send(service: Any, pair: drivers.CapturedPair, receiver: Receiver) -> Job:
    webhook = {"url": receiver.url, "secret": SECRET}
    job: Job = service.upload(pair, lights=2, webhook=webhook)
    return job


def _told(service: Any, job: Job) -> dict[str, Any]:
    """Wait until the webhook is told or given up; what came of it."""
    ends = ("delivered", "failed")
    service.await_that("it is told", lambda: service.look(job)["webhook"]["state"] in ends)
    webhook: dict[str, Any] = service.look(job)["webhook"]
    return webhook


def test_a_webhook_is_told_until_it_takes_it(
    breakable: Any, small_pair: drivers.CapturedPair
) -> None:
    with receiving(500, 302, 204, location="http://127.0.0.1:1/") as receiver:
        job = _send(breakable, small_pair, receiver)
        told = [receiver.next() for _ in range(3)]
        webhook = _told(breakable, job)
    assert webhook == {"url": receiver.url, "state": "delivered", "attempts": 3, "last_status": 204}
    assert {one.headers["webhook-id"] for one in told} == {f"job_{job['id']}"}
    end = breakable.look(job)
    for one in told:
        assert (one.event["type"], one.event["data"]["id"]) == ("job.succeeded", job["id"])
        assert one.event["data"]["files"] == end["files"]
    with receiving(410) as receiver, breakable.held():  # one that wants to hear no more
        running = breakable.upload(small_pair, lights=2)
        breakable.await_stage(running)
        job = _send(breakable, small_pair, receiver)
        breakable.http.post(job["links"]["cancel"])
        assert receiver.next().event["type"] == "job.canceled"
        assert _told(breakable, job)["state"] == "failed"
        assert receiver.told.empty()
    breakable.http.delete(running["links"]["self"])
    log = breakable.log.read_text()
    assert "webhook answered 204" in log
    assert SECRET.removeprefix("whsec_") not in log and "token=hidden" not in log


def test_an_end_is_told_though_its_worker_is_killed_while_it_tells(
    breakable: Any, small_pair: drivers.CapturedPair
) -> None:
    with receiving(204) as receiver:
        workers = breakable.find("worker")

        def kill() -> None:
            if workers:
                os.kill(workers.pop(), signal.SIGKILL)

        receiver.before = kill
        job = _send(breakable, small_pair, receiver)
        told = [receiver.next(), receiver.next()]
        webhook = _told(breakable, job)
    assert (webhook["state"], webhook["attempts"]) == ("delivered", 1)
    assert {one.headers["webhook-id"] for one in told} == {f"job_{job['id']}"}
    end = breakable.look(job)
    assert (end["state"], end["attempt"]) == ("succeeded", 1)


def test_an_end_that_was_not_queued_is_told_after_a_start(
    breakable: Any, small_pair: drivers.CapturedPair
) -> None:
    with receiving(204) as receiver:
        job = _send(breakable, small_pair, receiver)
        receiver.next()
        _told(breakable, job)
        breakable.stop()
        # As a kill right after the write of the end leaves it.
        with sqlite3.connect(breakable.data / "lightlayers.sqlite") as database:
            database.execute("UPDATE jobs SET delivery = NULL WHERE id = ?", (job["id"],))
            database.execute(
                "DELETE FROM workflow_status WHERE workflow_uuid LIKE ?",
                (f"{job['id']}-webhook-%",),
            )
        database.close()
        breakable.start()
        assert receiver.next().event["data"]["id"] == job["id"]
        assert _told(breakable, job)["state"] == "delivered"


def test_a_webhook_in_a_private_network_is_refused(service: Any) -> None:
    with receiving(204) as receiver:
        webhook = {"url": receiver.url, "secret": SECRET}
        wanted = {"capture": {"camera": "sim://studio"}, "webhook": webhook}
        answer = service.http.post("/jobs", json=wanted)
        assert receiver.told.empty()
    assert answer.status_code == 422
    assert answer.json()["detail"].startswith("webhook.url: this service calls no addresses of")


def test_a_stream_ends_with_the_service_and_goes_on_after_its_start(
    breakable: Any, small_pair: drivers.CapturedPair
) -> None:
    seen: list[Event] = []
    with breakable.held():
        job = breakable.upload(small_pair, lights=2)
        path = f"{job['links']['self']}/events"
        with breakable.http.stream("GET", path) as answer:
            told = False
            for event in events(answer):
                if event.data is None:  # a comment
                    continue
                seen.append(event)
                # a quick stage may pass unseen
                if event.data["attempt"] == 1 and event.data["stage"] and not told:
                    breakable.terminate()
                    told = True
        assert seen[-1].data["state"] in ("queued", "running")
        assert breakable.stop() == 0
    breakable.start()
    with breakable.http.stream("GET", path, headers={"last-event-id": seen[-1].id}) as answer:
        rest = list(events(answer))
    ids = [event.id for event in (*seen, *rest) if event.data]
    assert len(set(ids)) == len(ids)
    assert (rest[-1].data["state"], rest[-1].data["attempt"]) == ("succeeded", 2)
    assert breakable.http.get(path, headers={"last-event-id": ids[-1]}).status_code == 204

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import httpx
import pytest
import sqlalchemy as sa

from service.api import events as route
from service.api import job_updates
from service.api.callers import Caller, Standing
from service.api.context import Context
from service.api.job_updates import JobUpdates
from service.rows import attempts, deliveries, expiry, jobs, tables
from service.settings import Settings
from tests.unit.service.asking import post_capture, problem_of
from tests.unit.service.receiver import SECRET
from tests.unit.service.streams import Event, events

Finish = Callable[[str, dict[str, bytes]], None]


@pytest.fixture(autouse=True)
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(job_updates, "_LOOK_SECONDS", 0.01)
    monkeypatch.setattr(job_updates, "_PLACES_SECONDS", 0.02)


def _watch(http: httpx.Client, job: dict[str, Any], seen: str | None = None) -> Iterator[Event]:
    headers = {"last-event-id": seen} if seen else {}
    with http.stream("GET", f"{job['links']['self']}/events", headers=headers) as answer:
        yield from events(answer)


def test_a_job_is_told_as_it_happens_up_to_its_end(http: httpx.Client, context: Context) -> None:
    job = post_capture(http)
    stream = _watch(http, job)
    first = next(stream)
    assert (first.id, first.name, first.data) == (
        "1.1",
        "message",
        http.get(job["links"]["self"]).json(),
    )
    with context.engine.begin() as connection:
        held = attempts.claim(connection, job["id"], "w1")
    assert held is not None
    second = next(stream)
    assert (second.id, second.data["state"], second.data["position"]) == ("2", "running", None)
    with context.engine.begin() as connection:
        attempts.report(connection, held, "layers", 0.5, 0.7)
    third = next(stream)
    assert (third.id, third.data["stage"], third.data["progress"]) == ("3", "layers", 0.7)
    with context.engine.begin() as connection:
        assert attempts.succeed(connection, held, [])
    last = next(stream)
    assert (last.id, last.data) == ("4", http.get(job["links"]["self"]).json())
    assert list(stream) == []


def test_a_place_in_the_queue_is_told_when_it_changes(http: httpx.Client) -> None:
    before, job = post_capture(http), post_capture(http)
    stream = _watch(http, job)
    assert next(stream).id == "1.2"
    http.post(before["links"]["cancel"])
    moved = next(stream)
    assert (moved.id, moved.data["position"]) == ("1.1", 1)
    http.post(job["links"]["cancel"])
    assert [event.data["state"] for event in stream] == ["canceled"]


def test_what_was_seen_is_not_told_again(http: httpx.Client, finish: Finish) -> None:
    job = post_capture(http)
    stream = _watch(http, job, "1.1")
    finish(job["id"], {})
    told = list(stream)
    assert "1.1" not in [event.id for event in told]
    assert told[-1].data["state"] == "succeeded"
    path = f"{job['links']['self']}/events"
    again = http.get(path, headers={"last-event-id": str(told[-1].id)})
    assert (again.status_code, again.content) == (204, b"")
    for other in (None, "1.1", "99", "nonsense"):
        seen = {"last-event-id": other} if other else {}
        with http.stream("GET", path, headers=seen) as answer:
            assert [event.data["state"] for event in events(answer)] == ["succeeded"]


def test_who_has_seen_all_so_far_of_a_job_that_goes_on_is_told_what_comes(
    http: httpx.Client,
) -> None:
    job = post_capture(http)
    path, seen = f"{job['links']['self']}/events", {"last-event-id": "1.1"}
    with http.stream("GET", path, headers=seen) as answer:
        assert answer.status_code == 200
        assert answer.headers["x-accel-buffering"] == "no"  # or nginx would hold it back
        http.post(job["links"]["cancel"])
        assert [event.data["state"] for event in events(answer)] == ["canceled"]


def test_a_deleted_job_ends_the_stream(http: httpx.Client, context: Context) -> None:
    job = post_capture(http)
    with context.engine.begin() as connection:
        assert attempts.claim(connection, job["id"], "w1")
    stream = _watch(http, job)
    next(stream)
    http.delete(job["links"]["self"])
    last = list(stream)[-1]
    assert (last.name, last.data) == ("deleted", {"id": job["id"]})


def test_an_unknown_job_is_a_problem_before_the_stream(http: httpx.Client) -> None:
    assert problem_of(http.get("/jobs/none/events"))[:2] == (404, "unknown-job")


def test_silence_is_broken_by_comments(http: httpx.Client, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(route, "KEEP_ALIVE_SECONDS", 0.05)
    stream = _watch(http, post_capture(http))
    next(stream)
    assert [next(stream).comment for _ in range(2)] == ["ping"] * 2
    stream.close()  # type: ignore[attr-defined]


def test_many_watchers_are_served_by_one_look(
    http: httpx.Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    looks: list[int] = []
    looking = threading.Lock()
    look = JobUpdates.look

    def alone(self: JobUpdates, seen: Any) -> Any:
        assert looking.acquire(blocking=False)
        try:
            looks.append(len(seen))
            return look(self, seen)
        finally:
            looking.release()

    monkeypatch.setattr(JobUpdates, "look", alone)
    made = [post_capture(http) for _ in range(3)]
    with (
        ThreadPoolExecutor(30) as pool,
        httpx.Client(
            base_url=http.base_url, timeout=60, limits=httpx.Limits(max_connections=None)
        ) as many,
    ):
        streams = [_watch(many, job) for job in made * 10]
        assert {event.data["state"] for event in pool.map(next, streams)} == {"queued"}
        for job in made:
            http.post(job["links"]["cancel"])
        ends = list(pool.map(lambda stream: list(stream)[-1].data["state"], streams))
    assert ends == ["canceled"] * 30
    assert max(looks) == 3


def test_a_client_that_goes_is_forgotten(http: httpx.Client, context: Context) -> None:
    stream = _watch(http, post_capture(http))
    next(stream)
    assert len(context.job_updates._watched) == 1
    stream.close()  # type: ignore[attr-defined]
    while context.job_updates._watched:
        threading.Event().wait(0.01)


def test_jobs_are_watched_again_after_nobody_has(http: httpx.Client, context: Context) -> None:
    for _ in range(2):
        job = post_capture(http)
        stream = _watch(http, job)
        assert next(stream).data["id"] == job["id"]
        poller = context.job_updates._poller
        assert poller is not None
        stream.close()  # type: ignore[attr-defined]
        while not poller.done():
            threading.Event().wait(0.01)


def test_a_database_that_was_away_is_watched_on(
    http: httpx.Client,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    job = post_capture(http)
    stream = _watch(http, job)
    next(stream)
    look, failed, fixed = JobUpdates.look, threading.Event(), threading.Event()

    def away(self: JobUpdates, seen: Any) -> Any:
        if fixed.is_set():
            return look(self, seen)
        failed.set()
        raise sa.exc.OperationalError("", {}, Exception("away"))

    monkeypatch.setattr(JobUpdates, "look", away)
    assert failed.wait(60)
    http.post(job["links"]["cancel"])
    fixed.set()
    assert [event.data["state"] for event in stream] == ["canceled"]
    assert [(line.getMessage(), line.exc_info) for line in caplog.records] == [
        ("jobs that are watched could not be looked at, database-unavailable: away", None)
    ]


def test_a_service_that_stops_sends_its_watchers_away(engine: sa.Engine) -> None:
    values = {"id": "a", "options": {}, "trace_id": "1" * 32, "request_hash": ""}
    with engine.begin() as connection:
        jobs.add(connection, values)

    async def watch() -> None:
        watched = JobUpdates(engine, Settings())
        standing = Standing(engine, Caller(""))
        stream = route._events(watched, standing, "a", None)
        told = [await anext(stream), await anext(stream)]
        assert b"queued" in told[1]
        waiting = asyncio.create_task(watched.until_over("a", 3600))
        rest = asyncio.create_task(anext(stream, None))
        await asyncio.sleep(0)
        watched.close()
        assert await rest is None
        await waiting
        assert [event async for event in route._events(watched, standing, "a", None)] == [
            b"retry: 2000\n\n"
        ]

    asyncio.run(watch())


@pytest.mark.parametrize("prefer", ["wait=60", 'respond-async, wait="60"', "Wait = 999"])
def test_a_poll_may_wait_for_the_end(prefer: str, http: httpx.Client, finish: Finish) -> None:
    job = post_capture(http)
    with ThreadPoolExecutor(1) as pool:
        waiting = pool.submit(http.get, job["links"]["self"], headers={"prefer": prefer})
        finish(job["id"], {})
        answer = waiting.result()
    assert answer.json()["state"] == "succeeded"
    assert answer.headers["preference-applied"] == "wait=60"


@pytest.mark.parametrize("prefer", ["", "wait=0", "wait=x", "wait=-1", "wait", "handling=strict"])
def test_a_poll_without_a_wish_to_wait_does_not(prefer: str, http: httpx.Client) -> None:
    job = post_capture(http)
    answer = http.get(job["links"]["self"], headers={"prefer": prefer})
    assert answer.json()["state"] == "queued"
    assert answer.headers.get("preference-applied") in (None, "wait=0")


def test_a_job_deleted_while_a_poll_waits_is_a_problem(
    http: httpx.Client, context: Context
) -> None:
    job = post_capture(http)
    with ThreadPoolExecutor(1) as pool:
        waiting = pool.submit(http.get, job["links"]["self"], headers={"prefer": "wait=60"})
        while not context.job_updates._watched:
            threading.Event().wait(0.01)
        with context.engine.begin() as connection:
            expiry.remove(connection, job["id"])
        assert problem_of(waiting.result())[:2] == (404, "unknown-job")


def _with_webhook(http: httpx.Client, **webhook: str) -> httpx.Response:
    wanted = {"url": "https://hook.example/?token=hidden", "secret": SECRET, **webhook}
    return http.post("/jobs", json={"capture": {"camera": "sim://studio"}, "webhook": wanted})


def test_a_webhook_is_shown_without_its_secret(http: httpx.Client, context: Context) -> None:
    answer = _with_webhook(http)
    job = answer.json()
    shown = {"url": "https://hook.example/?token=hidden", "attempts": 0, "last_status": None}
    assert job["webhook"] == {**shown, "state": "waiting"}
    http.post(job["links"]["cancel"])
    ended = http.get(job["links"]["self"])
    assert ended.json()["webhook"] == {**shown, "state": "pending"}
    with context.engine.begin() as connection:
        delivery = {"state": "failed", "attempts": 12, "last_status": 500}
        deliveries.write(connection, job["id"], delivery)
    told = http.get(job["links"]["self"])
    assert told.json()["webhook"] == {**shown, **delivery}
    for text in (answer.text, ended.text, told.text, http.get("/jobs").text):
        assert SECRET.removeprefix("whsec_") not in text


@pytest.mark.parametrize(
    ("webhook", "why"),
    [
        ({"url": "http://127.0.0.1:8000/"}, "webhook.url: this service calls no addresses of"),
        ({"url": "http://0x7f.1/"}, "webhook.url: this service calls no addresses of"),
        ({"url": "ftp://hook.example/"}, "webhook.url: this service calls https and http only."),
        ({"url": "https://a:secretword@hook.example/"}, "webhook.url: leave user and password"),
        ({"url": ""}, "webhook.url"),
        ({"url": "https://" + "a" * 2048}, "webhook.url"),
        ({"secret": "secretword"}, "webhook.secret"),
        ({"secret": "whsec_" + "A" * 33}, "webhook.secret: write whsec_ and base64 of 24 to 64"),
        ({"secret": "whsec_" + "A" * 88}, "webhook.secret: write whsec_ and base64 of 24 to 64"),
        ({"secret": "whsec_" + "A" * 20}, "webhook.secret: write whsec_ and base64 of 24 to 64"),
        ({"secret": "A" * 38}, "webhook.secret: write whsec_ and base64 of 24 to 64"),
        ({"secret": "whsec_" + "A" * 32 + "\n"}, "webhook.secret: write whsec_ and base64"),
        ({"more": "secretword"}, "webhook.more"),
    ],
)
def test_a_webhook_that_cannot_be_told_is_refused(
    webhook: dict[str, str], why: str, http: httpx.Client, context: Context
) -> None:
    status, kind, detail = problem_of(_with_webhook(http, **webhook))
    assert (status, kind) == (422, "invalid-option")
    assert detail.startswith(why)
    assert "secretword" not in detail and "AAAA" not in detail
    with context.engine.connect() as connection:
        assert connection.execute(sa.select(tables.jobs.c.id)).all() == []

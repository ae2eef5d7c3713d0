from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from typing import Any

import httpx
import psycopg
import pytest
import sqlalchemy as sa

from service.api import callers, create_app
from service.api import events as api_events
from service.api.callers import OPEN, Caller, Standing, scopes_for
from service.api.camera_discovery import CameraDiscovery
from service.api.context import Context
from service.rows import keys, tables
from service.rows.clock import now
from service.settings import Settings
from tests.unit.service.asking import (
    bearing,
    owner_of,
    post_capture,
    problem_of,
    stored,
    stored_job,
)
from tests.unit.service.streams import events

Png = Callable[..., bytes]
Finish = Callable[[str, dict[str, bytes]], None]
CAPTURE = {"capture": {"camera": "sim://studio"}}


def _operations() -> list[tuple[str, str]]:
    paths: dict[str, dict[str, Any]] = create_app().openapi()["paths"]
    return [(method.upper(), path) for path, methods in paths.items() for method in methods]


def test_without_keys_a_service_on_loopback_asks_for_none(http: httpx.Client) -> None:
    assert post_capture(http)["owner"] == ""
    assert len(http.get("/jobs").json()["jobs"]) == 1


class TestRequired:
    @pytest.fixture
    def settings(self, settings: Settings) -> Settings:
        return settings.model_copy(update={"keys": "required"})

    @pytest.mark.parametrize(("method", "path"), [*_operations(), ("GET", "/openapi.json")])
    def test_every_route_but_health_needs_a_key(
        self, method: str, path: str, http: httpx.Client
    ) -> None:
        unknown = "1" * 32
        answer = http.request(
            method, path.format(job_id=unknown, upload_id=unknown, camera_id="x", name="x")
        )
        if path in OPEN:
            assert answer.status_code == (503 if path == "/readyz" else 200)  # no worker lives
            return
        assert (answer.status_code, answer.headers["www-authenticate"]) == (401, "Bearer")
        if method != "HEAD":
            assert problem_of(answer)[:2] == (401, "unauthorized")

    @pytest.mark.parametrize(
        "header",
        [
            "Bearer",
            "Bearer nonsense",
            "Basic dTpw",
            "ll_0123456789_" + "a" * 38,
            "Bearer ' OR 1=1 --",
            b"Bearer \xff\xfe",
        ],
    )
    def test_what_is_no_key_is_refused(
        self, header: str | bytes, http: httpx.Client, context: Context
    ) -> None:
        bearing(context, "admin")
        text = header if isinstance(header, bytes) else header.encode()
        assert http.get("/jobs", headers=[(b"authorization", text)]).status_code == 401

    def test_a_revoked_key_ends_with_the_next_request(
        self, http: httpx.Client, context: Context
    ) -> None:
        key = bearing(context, "read")
        assert http.get("/jobs", headers=key).status_code == 200
        with context.engine.begin() as connection:
            keys.revoke(connection, owner_of(key))
        assert http.get("/jobs", headers=key).status_code == 401

    @pytest.mark.parametrize("path", ["/jobs/{id}/events", "/cameras/events"])
    def test_a_key_that_is_revoked_ends_its_streams(
        self, path: str, http: httpx.Client, context: Context, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(callers, "STANDING_SECONDS", 0.01)
        monkeypatch.setattr(CameraDiscovery, "refresh", lambda _looking: None)
        monkeypatch.setattr(api_events, "KEEP_ALIVE_SECONDS", 0.02)
        key = bearing(context, "read", "capture")
        job = stored_job(context, owner=owner_of(key))
        with http.stream("GET", path.format(id=job), headers=key) as answer:
            stream = events(answer)
            next(stream)
            with context.engine.begin() as connection:
                keys.revoke(connection, owner_of(key))
            assert all(number < 500 for number, _ in enumerate(stream))
        assert http.get("/jobs", headers=key).status_code == 401

    def test_use_is_seen(self, http: httpx.Client, context: Context) -> None:
        key = bearing(context, "read")
        with context.engine.connect() as connection:
            before = connection.execute(sa.select(now())).scalar_one()
        http.get("/jobs", headers=key)
        with context.engine.connect() as connection:
            used = keys.list_keys(connection)[0].used
            assert used is not None
            assert before <= used <= connection.execute(sa.select(now())).scalar_one()

    @pytest.mark.parametrize(("ago", "noted"), [(keys.USED_SECONDS + 60, True), (60, False)])
    def test_use_is_noted_once_an_hour(
        self, ago: float, noted: bool, http: httpx.Client, context: Context
    ) -> None:
        key = bearing(context, "read")
        with context.engine.begin() as connection:
            connection.execute(sa.update(tables.keys).values(used=now() - ago))
            before = keys.list_keys(connection)[0].used
        assert http.get("/jobs", headers=key).status_code == 200
        with context.engine.connect() as connection:
            after = keys.list_keys(connection)[0].used
        assert before is not None and after is not None
        assert (after > before + keys.USED_SECONDS) is noted
        assert (after == before) is not noted

    def test_a_key_is_good_where_its_use_cannot_be_noted(
        self, http: httpx.Client, context: Context, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def note(_connection: object, _key: object) -> None:
            raise sa.exc.OperationalError("x", None, psycopg.errors.DiskFull())

        monkeypatch.setattr(keys, "note_use", note)
        assert http.get("/jobs", headers=bearing(context, "read")).status_code == 200


def test_a_stream_goes_on_while_all_connections_to_the_database_are_in_use(
    context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    def look(_standing: Standing) -> bool:
        raise sa.exc.TimeoutError("all connections are in use")

    monkeypatch.setattr(callers, "STANDING_SECONDS", 0.0)
    monkeypatch.setattr(Standing, "_look", look)
    assert asyncio.run(Standing(context.engine, Caller("")).holds())


def test_the_first_key_ends_streams_without_one(
    http: httpx.Client, context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(callers, "STANDING_SECONDS", 0.01)
    monkeypatch.setattr(api_events, "KEEP_ALIVE_SECONDS", 0.02)
    with http.stream("GET", f"/jobs/{post_capture(http)['id']}/events") as answer:
        stream = events(answer)
        # on a busy machine the job itself may come behind a comment
        assert [next(stream).comment for _ in range(4)].count("ping") == 3
        bearing(context, "read")
        assert all(number < 500 for number, _ in enumerate(stream))


def test_the_first_key_ends_the_time_without_keys(http: httpx.Client, context: Context) -> None:
    post_capture(http)
    key = bearing(context, "read")
    assert http.get("/jobs").status_code == 401
    assert http.get("/jobs", headers=key).json()["jobs"] == []
    with context.engine.begin() as connection:
        keys.revoke(connection, owner_of(key))
    assert http.get("/jobs").status_code == 401  # revoking the last one does not open the door


@pytest.mark.parametrize(
    "header", ["Forwarded", "Via", "X-Forwarded-For", "X-Forwarded-Host", "X-Real-IP"]
)
def test_what_a_proxy_passes_on_needs_a_key(header: str, http: httpx.Client) -> None:
    assert http.get("/jobs", headers={header: "127.0.0.1"}).status_code == 401


@pytest.mark.parametrize("origin", ["https://evil.example", "null", "http://127.0.0.1:1", ""])
def test_pages_of_other_sites_make_no_jobs_without_a_key(origin: str, http: httpx.Client) -> None:
    answer = http.post("/jobs", json=CAPTURE, headers={"origin": origin})
    assert problem_of(answer)[:2] == (403, "foreign-origin")
    assert http.get("/jobs").json()["jobs"] == []


def test_its_own_pages_do(http: httpx.Client) -> None:
    origin = str(http.base_url).rstrip("/")
    assert http.post("/jobs", json=CAPTURE, headers={"origin": origin}).status_code == 202


@pytest.mark.parametrize(
    ("method", "path", "good"),
    [
        ("GET", "/jobs", {"read"}),
        ("GET", "/jobs/1", {"read"}),
        ("GET", "/jobs/1/results", {"read"}),
        ("GET", "/jobs/1/results/x", {"read"}),
        ("GET", "/jobs/1/results.zip", {"read"}),
        ("POST", "/jobs", {"submit", "capture"}),
        ("POST", "/calibrations", {"submit", "capture"}),
        ("POST", "/jobs/1/cancel", {"submit"}),
        ("POST", "/jobs/1/rerun", {"submit"}),
        ("POST", "/jobs/1/mix", {"submit"}),
        ("POST", "/jobs/1/confirm", {"capture"}),
        ("POST", "/uploads", {"submit"}),
        ("DELETE", "/jobs/1", {"submit"}),
        ("GET", "/cameras", {"capture"}),
    ],
)
def test_every_route_wants_its_scope(
    method: str, path: str, good: set[str], http: httpx.Client, context: Context
) -> None:
    for scope in keys.Scope:
        answer = http.request(method, path, headers=bearing(context, scope))
        if scope in good | {"admin"}:
            assert answer.status_code not in (401, 403)
        else:
            status, kind, detail = problem_of(answer)
            assert (status, kind) == (403, "forbidden")
            assert all(word in detail for word in good)


@pytest.mark.parametrize(
    ("path", "options"),
    [
        ("/jobs", {}),
        ("/calibrations", {"kind": "flash", "card": {"x": 20, "y": 20, "radius": 5}}),
    ],
)
def test_a_pair_wants_submit_and_a_capture_capture(
    path: str, options: dict[str, Any], http: httpx.Client, context: Context, png: Png
) -> None:
    submit, capture = bearing(context, "submit"), bearing(context, "capture")
    by_camera = CAPTURE | {"options": options}
    files = {"no_flash": png(64, 48), "flash": png(64, 48, True)}
    pair: dict[str, Any] = {"files": files, "data": {"options": json.dumps(options)}}
    assert problem_of(http.post(path, json=by_camera, headers=submit))[1] == "forbidden"
    assert problem_of(http.post(path, **pair, headers=capture))[1] == "forbidden"
    assert context.storage.list("") == []
    assert http.post(path, **pair, headers=submit).status_code == 202
    assert http.post(path, json=by_camera, headers=capture).status_code == 202


def test_a_key_sees_only_its_own_jobs(http: httpx.Client, context: Context, finish: Finish) -> None:
    ours, theirs = (bearing(context, "submit", "read", "capture") for _ in range(2))
    job = post_capture(http, **ours)
    finish(job["id"], {"lamp1.jpg": b"light", "manifest.json": b"{}"})
    here = job["links"]["self"]
    asked = [
        ("GET", here),
        ("GET", f"{here}/results"),
        ("GET", f"{here}/results/lamp1.jpg"),
        ("HEAD", f"{here}/results/lamp1.jpg"),
        ("GET", f"{here}/results.zip"),
        ("POST", f"{here}/cancel"),
        ("DELETE", here),
    ]
    unknown = http.get(f"/jobs/{'0' * 32}", headers=theirs).json()["title"]
    for method, path in asked:
        answer = http.request(method, path, headers=theirs)
        assert answer.status_code == 404
        if method != "HEAD":
            assert answer.json()["title"] == unknown
    later = f"/jobs?after=9999999999.5-{job['id']}"
    for path, key, found in [("/jobs", theirs, []), (later, theirs, []), (later, ours, [job])]:
        listed = http.get(path, headers=key).json()["jobs"]
        assert [one["id"] for one in listed] == [one["id"] for one in found]
    assert http.get(f"{here}/results/lamp1.jpg", headers=ours).content == b"light"


def test_a_key_changes_nothing_of_anothers_job_that_goes_on(
    http: httpx.Client, context: Context
) -> None:
    ours, theirs = (bearing(context, "submit", "read", "capture") for _ in range(2))
    job = post_capture(http, **ours)
    here, before = job["links"]["self"], stored(context.engine, job["id"])
    for method, path in (
        ("POST", f"{here}/cancel"),
        ("POST", f"{here}/confirm"),
        ("POST", f"{here}/rerun"),
        ("GET", f"{here}/events"),
        ("DELETE", here),
    ):
        assert http.request(method, path, headers=theirs).status_code == 404
    assert stored(context.engine, job["id"]) == before


def test_an_idempotency_key_is_each_keys_own(http: httpx.Client, context: Context) -> None:
    made = {
        post_capture(http, **bearing(context, "capture"), **{"idempotency-key": "once"})["id"]
        for _ in range(2)
    }
    assert len(made) == 2


def test_a_calibration_of_another_key_is_unknown(
    http: httpx.Client, context: Context, png: Png
) -> None:
    ours, theirs = bearing(context, "submit"), bearing(context, "submit")
    options = {"options": '{"kind": "flash", "card": {"x": 9, "y": 9, "radius": 3}}'}
    files = {"no_flash": png(64, 48), "flash": png(64, 48, True)}
    made = http.post("/calibrations", files=files, data=options, headers=ours)
    assert made.status_code == 202
    named = json.dumps({"flash_spectrum": {"calibration": made.json()["id"]}})
    told = {
        name: http.post("/jobs", files=files, data={"options": named}, headers=key).json()["detail"]
        for name, key in (("ours", ours), ("theirs", theirs))
    }
    assert "wait until it has succeeded" in told["ours"]
    assert "there is no calibration" in told["theirs"]


def test_an_administrator_sees_and_ends_all_jobs(http: httpx.Client, context: Context) -> None:
    owners = [bearing(context, "capture") for _ in range(2)]
    made = [post_capture(http, **key) for key in owners]
    admin = bearing(context, "admin")
    found = http.get("/jobs", headers=admin).json()["jobs"]
    assert {(job["id"], job["owner"]) for job in found} == {
        (job["id"], owner_of(key)) for job, key in zip(made, owners, strict=True)
    }
    first, second = (job["links"]["self"] for job in made)
    assert http.post(f"{first}/cancel", headers=admin).json()["state"] == "canceled"
    assert http.delete(second, headers=admin).status_code == 204


def test_the_document_names_the_scopes_of_every_operation() -> None:
    document = create_app().openapi()
    assert document["components"]["securitySchemes"]["key"]["scheme"] == "bearer"
    for path, methods in document["paths"].items():
        for method, operation in methods.items():
            wanted = [] if path in OPEN else scopes_for(method.upper(), path)
            assert operation["security"] == [{"key": [scope]} for scope in wanted]
            assert path in OPEN or {"401", "403"} <= set(operation["responses"])


def test_who_has_no_key_is_no_administrator() -> None:
    assert keys.Scope.ADMIN not in Caller("").scopes

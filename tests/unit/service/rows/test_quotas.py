from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import httpx
import pytest
import sqlalchemy as sa

from service.api.context import Context
from service.errors import QuotaError
from service.rows import cameras, clock, jobs, quotas, tables
from tests.unit.service.asking import bearing, owner_of, post_capture, post_pair, problem_of

Png = Callable[..., bytes]
Finish = Callable[[str, dict[str, bytes]], None]
CAPTURE = {"capture": {"camera": "sim://studio"}}


def test_jobs_that_wait_are_counted_per_key(http: httpx.Client, context: Context) -> None:
    few = bearing(context, "capture", "submit", waiting_jobs=2)
    many = bearing(context, "capture")
    first = post_capture(http, **few)
    post_capture(http, **few)
    post_capture(http, **many)
    refused = http.post("/jobs", json=CAPTURE, headers=few)
    status, kind, detail = problem_of(refused)
    assert (status, kind) == (429, "quota-exceeded")
    assert detail == (
        "This key may have 2 jobs wait at a time, and has; send this one again when one has "
        "started."
    )
    assert refused.headers["retry-after"] == "10"
    http.post(first["links"]["cancel"], headers=few)
    post_capture(http, **few)


@pytest.mark.parametrize(
    ("quota", "expected"),
    [
        (
            "waiting_jobs",
            "This key may have 3 jobs wait at a time, and has 1; ask for fewer than these 3, or "
            "wait till some have begun.",
        ),
        (
            "jobs_per_day",
            "This key may make 3 jobs a day, and has made 1; ask for fewer than these 3; the next "
            "day begins at midnight UTC.",
        ),
    ],
)
def test_a_burst_that_a_quota_has_no_room_for_is_refused_at_once(
    quota: str,
    expected: str,
    http: httpx.Client,
    context: Context,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    key = bearing(context, "capture", **{quota: 3})
    burst = f"/cameras/{cameras.id_of('sim://studio')}/captures"
    post_capture(http, **key)
    with monkeypatch.context() as begun:
        begun.setattr(jobs, "add_burst", pytest.fail)
        refused = http.post(burst, json={"pairs": 3}, headers=key)
    assert problem_of(refused) == (429, "quota-exceeded", expected)
    assert http.post(burst, json={"pairs": 2}, headers=key).status_code == 202


def test_a_burst_is_charged_once(http: httpx.Client, context: Context) -> None:
    key = bearing(context, "capture", jobs_per_day=5, waiting_jobs=5, stored_bytes=1000)
    burst = f"/cameras/{cameras.id_of('sim://studio')}/captures"
    post_capture(http, **key)  # since when the service knows the camera
    sums: list[str] = []

    def note(_c: object, _cursor: object, query: str, *_more: object) -> None:
        if "sum(jobs.stored_bytes)" in query:
            sums.append(query)

    sa.event.listen(context.engine, "before_cursor_execute", note)
    assert http.post(burst, json={"pairs": 3}, headers=key).status_code == 202
    assert len(sums) == 3  # before the body is read, once it is, and with all the rows
    with context.engine.connect() as connection:
        assert connection.execute(sa.select(tables.keys.c.jobs_of_day)).scalar_one() == 4
    refused = http.post(burst, json={"pairs": 2}, headers=key)
    assert problem_of(refused)[:2] == (429, "quota-exceeded")


@pytest.mark.parametrize("quota", ["waiting_jobs", "jobs_per_day"])
def test_bursts_at_once_do_not_get_past_a_quota(
    quota: str, http: httpx.Client, context: Context
) -> None:
    key = bearing(context, "capture", **{quota: 8})
    burst = f"/cameras/{cameras.id_of('sim://studio')}/captures"
    post_capture(http, **key)

    def ask(_number: int) -> int:
        return http.post(burst, json={"pairs": 3}, headers=key).status_code

    with ThreadPoolExecutor(4) as pool:
        assert sorted(pool.map(ask, range(4))) == [202] * 2 + [429] * 2
    with context.engine.connect() as connection:
        assert connection.execute(sa.select(tables.keys.c.jobs_of_day)).scalar_one() == 7


def test_jobs_of_a_day_count_even_if_they_are_deleted(http: httpx.Client, context: Context) -> None:
    key = bearing(context, "capture", "submit", jobs_per_day=2)
    for _ in range(2):
        job = post_capture(http, **key)
        assert http.delete(job["links"]["self"], headers=key).status_code == 204
    refused = http.post("/jobs", json=CAPTURE, headers=key)
    assert problem_of(refused)[:2] == (429, "quota-exceeded")
    with context.engine.begin() as connection:
        connection.execute(sa.update(tables.keys).values(day=tables.keys.c.day - 1))
    post_capture(http, **key)


def test_who_has_used_up_a_day_is_told_when_the_next_one_begins(
    http: httpx.Client, context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(quotas, "_now", lambda _connection: 20_000 * 86400 - 100.5)
    key = bearing(context, "capture", jobs_per_day=1)
    post_capture(http, **key)
    refused = http.post("/jobs", json=CAPTURE, headers=key)
    assert problem_of(refused)[:2] == (429, "quota-exceeded")
    assert refused.headers["retry-after"] == "101"


def test_a_replay_costs_nothing(http: httpx.Client, context: Context) -> None:
    key = bearing(context, "capture", jobs_per_day=1) | {"idempotency-key": "once"}
    first = post_capture(http, **key)
    assert post_capture(http, **key)["id"] == first["id"]


def test_bytes_are_those_of_photographs_and_results(
    http: httpx.Client, context: Context, png: Png, finish: Finish
) -> None:
    pair = png(64, 48), png(64, 48, True)
    size = len(pair[0]) + len(pair[1])
    key = bearing(context, "submit", stored_bytes=size + 1000)
    job = post_pair(http, *pair, headers=key).json()
    finish(job["id"], {"lamp1.jpg": b"x" * 1000})
    refused = post_pair(http, *pair, headers=key)
    assert problem_of(refused)[:2] == (403, "stored-quota")
    assert http.delete(job["links"]["self"], headers=key).status_code == 204
    assert post_pair(http, *pair, headers=key).status_code == 202


def test_a_pair_that_does_not_fit_is_not_kept(
    http: httpx.Client, context: Context, png: Png
) -> None:
    key = bearing(context, "submit", stored_bytes=10)
    refused = post_pair(http, png(64, 48), png(64, 48, True), headers=key)
    assert problem_of(refused)[:2] == (403, "stored-quota")
    assert context.storage.list("") == []
    with context.engine.connect() as connection:
        assert connection.execute(sa.select(tables.jobs)).all() == []


@pytest.mark.parametrize("quota", ["waiting_jobs", "jobs_per_day"])
def test_requests_at_once_do_not_get_past_a_quota(
    quota: str, http: httpx.Client, context: Context
) -> None:
    key = bearing(context, "capture", **{quota: 3})

    def ask(_number: int) -> int:
        return http.post("/jobs", json=CAPTURE, headers=key).status_code

    with ThreadPoolExecutor(8) as pool:
        assert sorted(pool.map(ask, range(8))) == [202] * 3 + [429] * 5


def test_a_charge_of_a_refused_job_is_taken_back(context: Context) -> None:
    owner = owner_of(bearing(context, "submit", jobs_per_day=1))
    with context.engine.begin() as connection:
        quotas.charge(connection, owner)
    with pytest.raises(QuotaError), context.engine.begin() as connection:
        quotas.charge(connection, owner)
    with context.engine.connect() as connection:
        assert connection.execute(sa.select(tables.keys.c.jobs_of_day)).scalar_one() == 1


def test_uploads_that_no_job_has_taken_count(http: httpx.Client, context: Context) -> None:
    key = bearing(context, "submit", stored_bytes=1000) | {"tus-resumable": "1.0.0"}

    def begin(length: int) -> httpx.Response:
        return http.post("/uploads", headers=key | {"upload-length": str(length)})

    first = begin(600)
    assert first.status_code == 201
    status, kind, detail = problem_of(begin(401))
    assert (status, kind) == (403, "stored-quota")
    assert "1,000 bytes" in detail and "delete jobs or uploads" in detail
    assert begin(400).status_code == 201
    assert http.delete(first.headers["location"], headers=key).status_code == 204
    assert begin(600).status_code == 201


@pytest.mark.parametrize("quota", ["waiting_jobs", "jobs_per_day"])
def test_no_upload_is_begun_that_no_job_may_be_made_of(
    quota: str, http: httpx.Client, context: Context
) -> None:
    key = bearing(context, "submit", "capture", **{quota: 1})
    headers = key | {"tus-resumable": "1.0.0", "upload-length": "3"}
    assert http.post("/uploads", headers=headers).status_code == 201
    post_capture(http, **key)
    assert problem_of(http.post("/uploads", headers=headers))[:2] == (429, "quota-exceeded")


def test_uploads_that_have_expired_count_no_more(http: httpx.Client, context: Context) -> None:
    key = bearing(context, "submit", stored_bytes=100)
    _upload(http, b"x" * 100, 99, key)
    headers = key | {"tus-resumable": "1.0.0", "upload-length": "100"}
    assert problem_of(http.post("/uploads", headers=headers))[:2] == (403, "stored-quota")
    with context.engine.begin() as connection:
        connection.execute(sa.update(tables.uploads).values(expires=clock.now() - 1))
    assert http.post("/uploads", headers=headers).status_code == 201


def _upload(http: httpx.Client, data: bytes, received: int, key: dict[str, str]) -> str:
    """Begin an upload, of which the first bytes come; its id."""
    headers = key | {
        "tus-resumable": "1.0.0",
        "upload-length": str(len(data)),
        "content-type": "application/offset+octet-stream",
    }
    answer = http.post("/uploads", headers=headers, content=data[:received])
    assert answer.status_code == 201
    return answer.headers["location"].rpartition("/")[2]


@pytest.mark.parametrize("received", [0, 1, 100])
def test_uploads_leave_less_room_for_jobs(
    received: int, http: httpx.Client, context: Context, png: Png
) -> None:
    pair = png(64, 48), png(64, 48, True)
    key = bearing(context, "submit", stored_bytes=len(pair[0]) + len(pair[1]) + 99)
    place = f"/uploads/{_upload(http, b'x' * 100, received, key)}"
    status, kind, detail = problem_of(post_pair(http, *pair, headers=key))
    assert (status, kind) == (403, "stored-quota")
    assert "This key's uploads" in detail
    assert context.storage.list("jobs/") == []
    http.delete(place, headers=key | {"tus-resumable": "1.0.0"}).raise_for_status()
    assert post_pair(http, *pair, headers=key).status_code == 202


def test_uploads_that_become_a_job_count_once(
    http: httpx.Client, context: Context, png: Png
) -> None:
    pair = {"no_flash": png(64, 48), "flash": png(64, 48, True)}
    size = sum(map(len, pair.values()))
    key = bearing(context, "submit", stored_bytes=size)
    ids = {frame: _upload(http, data, len(data), key) for frame, data in pair.items()}
    assert http.post("/jobs", json={"uploads": ids}, headers=key).status_code == 202
    with context.engine.connect() as connection:
        assert connection.execute(sa.select(tables.jobs.c.stored_bytes)).scalar_one() == size
    assert problem_of(post_pair(http, *pair.values(), headers=key))[:2] == (403, "stored-quota")


def test_a_key_that_uploads_have_filled_is_told_before_a_pair_is_read(
    http: httpx.Client, context: Context
) -> None:
    key = bearing(context, "submit", stored_bytes=100)
    _upload(http, b"x" * 100, 99, key)
    assert problem_of(http.post("/jobs", headers=key))[:2] == (403, "stored-quota")


def test_uploads_begun_at_once_do_not_get_past_a_quota(
    http: httpx.Client, context: Context
) -> None:
    key = bearing(context, "submit", stored_bytes=1000) | {"tus-resumable": "1.0.0"}
    headers = key | {"upload-length": "400"}
    with ThreadPoolExecutor(6) as pool:
        answers = list(pool.map(lambda _: http.post("/uploads", headers=headers), range(6)))
    assert sorted(answer.status_code for answer in answers) == [201, 201, 403, 403, 403, 403]

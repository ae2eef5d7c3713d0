"""Text from outside that tries to be a path, SQL, a template, a header or a line of the log."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Callable
from urllib.parse import quote

import httpx
import pytest
import sqlalchemy as sa

from service.api.context import Context
from service.api.zips import Member, stored_zip
from service.rows import tables
from tests.unit.service.asking import post_capture, post_pair, rows_of

Png = Callable[..., bytes]
Finish = Callable[[str, dict[str, bytes]], None]

HOSTILE = [
    "../../../etc/passwd",
    "..%2f..%2fetc%2fpasswd",
    "/etc/passwd",
    "..\\..\\boot.ini",
    "file:///etc/passwd",
    "' OR '1'='1",
    "1; DROP TABLE jobs; --",
    "%' UNION SELECT digest FROM keys --",
    "{{1913*1913}}${1913*1913}<%= 1913*1913 %>",
    "<script>alert(1)</script>",
    "a\r\nSet-Cookie: a=b",
    "a\nb",
    "\x00",
    "\u202egpj.exe",
    "é" * 300,
    "a" * 5000,
]


def _is_harmless(answer: httpx.Response, context: Context) -> bool:
    assert answer.status_code < 500
    assert "set-cookie" not in answer.headers
    assert b"root:" not in answer.content
    assert b"3659569" not in answer.content  # 1913²: nothing was worked out
    assert answer.headers["content-type"].startswith(("application/problem+json", "application/js"))
    with context.engine.connect() as connection:
        assert connection.execute(sa.select(sa.func.count()).select_from(tables.jobs)).scalar()
    return True


def test_ids_and_names_are_only_looked_up(
    http: httpx.Client, context: Context, finish: Finish
) -> None:
    job = post_capture(http)
    finish(job["id"], {"lamp1.jpg": b"light", "manifest.json": b"{}"})
    for text in (quote(text, safe="") for text in HOSTILE):
        for path in (
            f"/jobs/{text}",
            f"/jobs/{text}/results.zip",
            f"{job['links']['self']}/results/{text}",
            f"/jobs?after={text}",
        ):
            answer = http.get(path)
            assert answer.status_code == (422 if "after=" in path else 404)
            assert _is_harmless(answer, context)
        assert http.delete(f"/jobs/{text}").status_code in (404, 405)
        assert http.get(f"/cameras/{text}/settings").status_code == 404
        for method in ("HEAD", "DELETE"):
            gone = http.request(method, f"/uploads/{text}", headers={"tus-resumable": "1.0.0"})
            assert gone.status_code in (404, 405)


def test_names_of_files_are_nothing_but_text(
    http: httpx.Client, context: Context, png: Png
) -> None:
    pair = png(64, 48), png(64, 48, True)
    for text in HOSTILE[::8]:
        made = http.post("/jobs", files={"no_flash": (text, pair[0]), "flash": (text, pair[1])})
        assert made.status_code == 202
        below = f"jobs/{made.json()['id']}/"
        stored = [f"{below}inputs/flash", f"{below}inputs/no_flash"]
        assert [key for key in context.storage.list("") if key.startswith(below)] == stored
    assert len(context.storage.list("")) == 2 * len(HOSTILE[::8])


def test_names_of_parts_are_refused_or_nothing(
    http: httpx.Client, context: Context, png: Png
) -> None:
    post_capture(http)
    for text in HOSTILE:
        unknown = http.post("/jobs", files={"no_flash": png(8, 8), text: ("a.png", png(8, 8))})
        assert unknown.status_code == 400
        assert _is_harmless(unknown, context)
    assert len(rows_of(context)) == 1 and context.storage.list("") == []


def test_options_and_addresses_are_nothing_but_values(http: httpx.Client, context: Context) -> None:
    post_capture(http)
    for text in HOSTILE:
        for body in (
            {"capture": {"camera": text}},
            {"capture": {"camera": "sim://studio"}, "options": {"outputs": [text]}},
            {"capture": {"camera": "sim://studio"}, text: 1},
            {
                "capture": {"camera": "sim://studio"},
                "options": {"flash_spectrum": {"calibration": text}},
            },
        ):
            answer = http.post("/jobs", json=body)
            assert 400 <= answer.status_code < 500
            assert _is_harmless(answer, context)
    assert len(rows_of(context)) == 1


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("Idempotency-Key", "a b"),
        ("Idempotency-Key", "é"),
        ("Idempotency-Key", "a" * 256),
        ("Idempotency-Key", ""),
    ],
)
def test_a_key_that_is_no_text_is_refused(name: str, value: str, http: httpx.Client) -> None:
    wanted = {"capture": {"camera": "sim://studio"}}
    headers = [(name.encode(), value.encode())]
    assert http.post("/jobs", json=wanted, headers=headers).status_code == 422


@pytest.mark.parametrize("key", ["');DROP/**/TABLE/**/jobs;--", "../../x", "{{7*7}}", "%00%0d%0a"])
def test_a_hostile_idempotency_key_is_nothing_but_text(
    key: str, http: httpx.Client, context: Context
) -> None:
    first = post_capture(http, **{"idempotency-key": key})
    assert post_capture(http, **{"idempotency-key": key})["id"] == first["id"]
    assert [row.idempotency_key for row in rows_of(context)] == [key]


@pytest.mark.parametrize(
    "value",
    [
        "bytes=-1,-1," + "0-1," * 2000,
        "bytes=" + "9" * 4000,
        "items=0-",
    ],
)
def test_a_hostile_range_gives_the_whole_file(
    value: str, http: httpx.Client, finish: Finish
) -> None:
    job = post_capture(http)
    finish(job["id"], {"lamp1.jpg": b"light"})
    answer = http.get(f"{job['links']['self']}/results/lamp1.jpg", headers={"range": value})
    assert answer.content == b"light" or answer.status_code == 400  # where it is no header at all
    assert "set-cookie" not in answer.headers


@pytest.mark.parametrize(
    "header",
    ["X-Forwarded-Proto", "X-Forwarded-Prefix", "X-Original-URL", "X-Rewrite-URL", "X-HTTP-Method"],
)
def test_headers_of_proxies_lead_nowhere(header: str, http: httpx.Client) -> None:
    post_capture(http)
    answer = http.get("/jobs?limit=1", headers={header: "//evil.example/DELETE"})
    assert answer.status_code == 200
    assert "evil" not in answer.text and "evil" not in str(answer.headers)


@pytest.mark.parametrize("host", ["evil.example", "localhost.evil.example"])
def test_no_host_gets_into_an_answer(host: str, http: httpx.Client) -> None:
    answer = http.get("/jobs", headers={"host": host})
    assert answer.status_code == 421
    assert "evil" not in answer.text and "evil" not in str(answer.headers)


@pytest.mark.parametrize("trace", ["00-" + "<" * 32 + "-0-0", "00-'-0-0", "x", "00-" + "é" * 32])
def test_a_hostile_trace_is_replaced(trace: str, http: httpx.Client) -> None:
    answer = http.get("/healthz", headers=[(b"traceparent", trace.encode())])
    assert len(answer.headers["trace-id"]) == 32
    assert set(answer.headers["trace-id"]) <= set("0123456789abcdef")


def test_names_in_a_zip_are_those_of_results(http: httpx.Client, finish: Finish) -> None:
    job = post_capture(http)
    finish(job["id"], {"lamp1.jpg": b"light", "manifest.json": b"{}"})
    data = http.get(f"{job['links']['self']}/results.zip")
    assert data.headers["content-disposition"] == f'attachment; filename="{job["id"]}.zip"'
    with zipfile.ZipFile(io.BytesIO(data.content)) as archive:
        assert archive.namelist() == ["lamp1.jpg", "manifest.json"]


@pytest.mark.parametrize("name", ["../lamp1.jpg", "/lamp1.jpg", "a/b.jpg", "a\\b.jpg", "", ".."])
def test_a_zip_has_no_names_that_lead_out(name: str) -> None:
    with pytest.raises(ValueError, match="no name of a file"):
        b"".join(stored_zip([Member(name, 1, lambda: [b"x"])]))


def test_two_ways_to_the_same_pair_are_not_mixed_up(http: httpx.Client, png: Png) -> None:
    job = post_pair(http, png(64, 48), png(64, 48, True)).json()
    assert http.get(f"/jobs/{job['id']}/inputs/no_flash").status_code == 404
    assert http.get(f"/jobs/{job['id']}/results/..%2Finputs%2Fno_flash").status_code in (404, 409)

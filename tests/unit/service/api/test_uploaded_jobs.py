"""Jobs of photographs that were uploaded before."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from typing import Any

import httpx
import pytest
import sqlalchemy as sa

from service.api.context import Context
from service.api.uploaded_pairs import bring_uploaded
from service.frames import FRAMES
from service.rows import tables
from tests.unit.service.asking import problem_of, rows_of
from tests.unit.service.uploading import create, patch, upload

Png = Callable[..., bytes]


class TestJobs:
    @pytest.fixture
    def pair(self, http: httpx.Client, png: Png) -> dict[str, str]:
        """Ids of two uploads."""
        return {"no_flash": upload(http, png(64, 48)), "flash": upload(http, png(64, 48, True))}

    def test_a_job_takes_its_uploads_over(
        self, http: httpx.Client, png: Png, pair: dict[str, str], context: Context
    ) -> None:
        wanted = {"uploads": pair, "options": {"lights": 2}, "priority": "high"}
        answer = http.post("/jobs", json=wanted)
        assert answer.status_code == 202, answer.text
        job = answer.json()
        sent = {"no_flash": png(64, 48), "flash": png(64, 48, True)}
        assert job["inputs"] == {
            frame: {"sha256": hashlib.sha256(data).hexdigest()} for frame, data in sent.items()
        }
        assert (job["options"], job["priority"]) == ({"lights": 2}, "high")
        keys = [f"jobs/{job['id']}/inputs/{frame}" for frame in ("flash", "no_flash")]
        assert context.storage.list("") == keys
        assert context.storage.get(keys[0]) == sent["flash"]
        again = http.post("/jobs", json=wanted)
        assert problem_of(again)[:2] == (422, "invalid-option")
        assert "a job may have used it" in again.json()["detail"]
        assert [row.id for row in rows_of(context)] == [job["id"]]

    def test_a_calibration_takes_uploads(self, http: httpx.Client, pair: dict[str, str]) -> None:
        options = {"kind": "lamps", "sphere": {"x": 20, "y": 20, "radius": 5}}
        answer = http.post("/calibrations", json={"uploads": pair, "options": options})
        assert (answer.status_code, answer.json()["options"]["kind"]) == (202, "lamps")

    def test_a_key_gives_the_job_after_its_uploads_are_gone(
        self, http: httpx.Client, pair: dict[str, str], context: Context
    ) -> None:
        headers = {"Idempotency-Key": "once"}
        first = http.post("/jobs", json={"uploads": pair}, headers=headers)
        again = http.post("/jobs", json={"uploads": pair}, headers=headers)
        assert (first.status_code, again.status_code) == (202, 202)
        assert again.json() == first.json()
        assert again.headers["idempotency-replayed"] == "true"
        swapped = {"no_flash": pair["flash"], "flash": pair["no_flash"]}
        for other in ({"uploads": pair, "options": {"lights": 1}}, {"uploads": swapped}):
            answer = http.post("/jobs", json=other, headers=headers)
            assert problem_of(answer)[:2] == (422, "idempotency-key-reused")
        assert len(rows_of(context)) == 1

    def test_a_key_gives_the_job_that_took_its_uploads_a_moment_ago(
        self,
        http: httpx.Client,
        pair: dict[str, str],
        context: Context,
        monkeypatch: pytest.MonkeyPatch,
    ) -> None:
        def send() -> httpx.Response:
            return http.post("/jobs", json={"uploads": pair}, headers={"Idempotency-Key": "once"})

        first: list[httpx.Response] = []

        def bring_late(*arguments: Any) -> dict[str, str]:
            monkeypatch.setattr("service.api.accept_pair.bring_uploaded", bring_uploaded)
            first.append(send())
            return bring_uploaded(*arguments)

        monkeypatch.setattr("service.api.accept_pair.bring_uploaded", bring_late)
        later = send()
        assert (first[0].status_code, later.status_code) == (202, 202)
        assert later.json()["id"] == first[0].json()["id"]
        assert later.headers["idempotency-replayed"] == "true"
        assert len(rows_of(context)) == 1

    def test_a_refused_pair_stays_uploaded(
        self, http: httpx.Client, pair: dict[str, str], context: Context
    ) -> None:
        bad = {**pair, "flash": upload(http, b"dear diary")}
        assert problem_of(http.post("/jobs", json={"uploads": bad}))[:2] == (
            422,
            "unreadable-image",
        )
        same = {**pair, "flash": pair["no_flash"]}
        assert problem_of(http.post("/jobs", json={"uploads": same}))[:2] == (422, "unusable-pair")
        assert rows_of(context) == []
        assert http.post("/jobs", json={"uploads": pair}).status_code == 202

    def test_an_upload_that_has_not_come_whole_is_refused(
        self, http: httpx.Client, pair: dict[str, str], context: Context
    ) -> None:
        place = create(http, 1000)
        patch(http, place, 0, b"abc")
        wanted = {"uploads": {**pair, "flash": place.rpartition("/")[2]}}
        answer = http.post("/jobs", json=wanted)
        assert problem_of(answer) == (
            409,
            "upload-unfinished",
            "uploads.flash: 3 of 1,000 bytes have come; send the rest first.",
        )
        assert rows_of(context) == []

    @pytest.mark.parametrize("frame", FRAMES)
    @pytest.mark.parametrize("change", [{"owner": "x"}, {"expires": 1.0}], ids=["owner", "expires"])
    def test_uploads_of_others_and_of_the_past_are_refused(
        self,
        change: dict[str, Any],
        frame: str,
        http: httpx.Client,
        pair: dict[str, str],
        context: Context,
    ) -> None:
        with context.engine.begin() as connection:
            one = tables.uploads.c.id == pair[frame]
            connection.execute(sa.update(tables.uploads).where(one).values(change))
        assert problem_of(http.post("/jobs", json={"uploads": pair})) == (
            422,
            "invalid-option",
            f"uploads.{frame}: there is no upload {pair[frame]!r}; it may have expired, or a job "
            "may have used it.",
        )
        assert rows_of(context) == []

    @pytest.mark.parametrize(
        ("body", "words"),
        [
            ({}, "Name the pair: `uploads` for photographs that are sent, or `capture` for a "),
            ({"uploads": {}}, "uploads.no_flash: Field required."),
            ({"uploads": {"no_flash": "x", "flash": "y"}}, "there is no upload 'x'"),
            ({"uploads": {"no_flash": "x", "flash": 1}}, "uploads.flash: "),
            ({"uploads": {"no_flash": "a" * 99, "flash": "y"}}, f"no upload '{'a' * 32}'"),
            ({"uploads": {"no_flash": "\0", "flash": "y"}}, "A text holds a NUL"),
            ({"uploads": [], "options": {}}, "uploads: "),
            ({"uploads": {}, "capture": {"camera": "sim://studio"}}, "uploads.no_flash: "),
        ],
    )
    def test_uploads_that_are_not_there_are_refused(
        self, body: dict[str, Any], words: str, http: httpx.Client
    ) -> None:
        status, kind, detail = problem_of(http.post("/jobs", json=body))
        assert (status, kind) == (422, "invalid-option")
        assert words in detail

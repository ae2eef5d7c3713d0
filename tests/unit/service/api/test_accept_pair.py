from __future__ import annotations

import errno
import os
import tempfile
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import Any

import httpx
import pytest

from service.api.context import Context
from service.errors import (
    AttemptError,
    CrashError,
    FileLimitError,
    KilledError,
    MemoryLimitError,
    NoProcessError,
    OutputLimitError,
    TimeLimitError,
)
from service.settings import Settings
from service.workers import sandbox
from tests.unit.service.asking import post_capture, post_pair, problem_of, rows_of
from tests.unit.service.at_first import raising

Png = Callable[..., bytes]
Checked = Callable[[Exception], httpx.Response]


def test_photographs_are_on_the_disk_before_their_job_is(
    http: httpx.Client, png: Png, context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    rows: dict[str, int] = {}

    def note(descriptor: int) -> None:
        name = Path(f"/proc/self/fd/{descriptor}").readlink().name
        rows[name] = len(rows_of(context))

    monkeypatch.setattr(os, "fsync", note)
    job = post_pair(http, png(64, 48), png(64, 48, True)).json()
    assert rows == dict.fromkeys(["flash", "no_flash", "inputs", job["id"], "jobs", "store"], 0)
    assert [row.id for row in rows_of(context)] == [job["id"]]


def test_photographs_that_the_disk_does_not_keep_make_no_job(
    http: httpx.Client,
    png: Png,
    context: Context,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    def fail(_descriptor: int) -> None:
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr(os, "fsync", fail)
    answer = post_pair(http, png(64, 48), png(64, 48, True))
    assert problem_of(answer)[:2] == (503, "store-unavailable")
    assert rows_of(context) == []
    assert context.storage.list("") == []
    said = "request failed, store-unavailable: the disk does not keep what was stored"
    told = [(one.getMessage(), one.exc_info, vars(one)["trace_id"]) for one in caplog.records]
    assert told == [(said, None, answer.json()["trace_id"])]


@pytest.fixture
def checked(http: httpx.Client, png: Png, monkeypatch: pytest.MonkeyPatch) -> Checked:
    """Send a pair whose check of headers ends so; what follows is checked as ever."""

    def send(end: Exception) -> httpx.Response:
        with monkeypatch.context() as ended:
            ended.setattr(sandbox, "run", raising(end))
            return post_pair(http, png(64, 48), png(64, 48, True))

    return send


@pytest.mark.parametrize(
    "death",
    [
        CrashError("It crashed."),
        MemoryLimitError("It wanted much."),
        FileLimitError("It opened many."),
        OutputLimitError("It wrote much."),
    ],
)
def test_what_kills_the_check_of_headers_is_no_photograph(
    death: AttemptError, checked: Checked, context: Context
) -> None:
    assert problem_of(checked(death)) == (422, "unreadable-image", str(death))
    assert context.storage.list("") == []


@pytest.mark.parametrize("death", [TimeLimitError("Too long."), KilledError("It was killed.")])
def test_a_check_that_an_overloaded_machine_ends_is_asked_for_again(
    death: AttemptError,
    checked: Checked,
    context: Context,
    http: httpx.Client,
    png: Png,
) -> None:
    answer = checked(death)
    assert problem_of(answer) == (503, "service-not-ready", str(death))
    assert answer.json()["retryable"]
    assert context.storage.list("") == []
    assert post_pair(http, png(64, 48), png(64, 48, True)).status_code == 202


def test_a_check_of_headers_takes_one_of_the_places_there_are(
    http: httpx.Client, png: Png, context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    def free() -> int:
        count = 0
        while context.checks.acquire(blocking=False):
            count += 1
        for _ in range(count):
            context.checks.release()
        return count

    during: list[int] = []
    monkeypatch.setattr(sandbox, "run", lambda *_arguments: during.append(free()))
    before = free()
    assert post_pair(http, png(64, 48), png(64, 48, True)).status_code == 202
    assert (during, free()) == ([before - 1], before)


def test_a_machine_without_processes_is_no_fault_of_the_photographs(
    checked: Checked, context: Context, http: httpx.Client, png: Png
) -> None:
    answer = checked(NoProcessError())
    status, kind, detail = problem_of(answer)
    assert (status, kind, answer.json()["retryable"]) == (503, "no-process", True)
    assert "send it again in a minute" in detail
    assert context.storage.list("") == []
    assert post_pair(http, png(64, 48), png(64, 48, True)).status_code == 202


def test_a_check_that_somebody_ends_is_asked_for_again(checked: Checked) -> None:
    answer = checked(ChildProcessError())
    assert problem_of(answer)[:2] == (503, "service-not-ready")
    assert answer.json()["retryable"]


def test_a_disk_that_fills_up_during_an_upload_is_told(
    http: httpx.Client, png: Png, monkeypatch: pytest.MonkeyPatch
) -> None:
    full = OSError(errno.ENOSPC, "No space left on device")
    monkeypatch.setattr(tempfile, "mkdtemp", raising(full))
    for answer in (
        post_pair(http, png(64, 48), png(64, 48, True)),
        http.post("/jobs", json={"capture": {"camera": "sim://studio"}}),
    ):
        status, kind, detail = problem_of(answer)
        assert (status, kind) == (507, "storage-full")
        assert "is full" in detail and answer.json()["retryable"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (
            {"flash_spectrum": {"wavelength_nm": [1] * 2001, "power": [1] * 2001}},
            "options.flash_spectrum.wavelength_nm: List should have at most 2000 items, not 2001.",
        ),
        (
            {"neutral": "D65" + "-" * 198},
            "options.neutral: String should have at most 200 characters or an object.",
        ),
    ],
)
def test_tables_and_names_of_any_length_are_refused(
    options: dict[str, Any], words: str, http: httpx.Client
) -> None:
    wanted = {"capture": {"camera": "sim://studio"}, "options": options}
    assert problem_of(http.post("/jobs", json=wanted)) == (422, "invalid-option", words)


class TestHandling:
    def test_is_normal_where_nothing_is_asked(self, http: httpx.Client) -> None:
        job = post_capture(http)
        assert (job["priority"], job["deadline"], job["expires"]) == ("normal", None, None)

    def test_comes_with_a_capture(self, http: httpx.Client) -> None:
        body = {"capture": {"camera": "sim://studio"}, "priority": "low"}
        assert http.post("/jobs", json=body).json()["priority"] == "low"

    def test_comes_with_a_pair(self, http: httpx.Client, png: Png) -> None:
        handling = '{"priority": "high", "deadline_seconds": 600}'
        answer = post_pair(http, png(64, 48), png(64, 48, True), data={"handling": handling})
        job = answer.json()
        assert job["priority"] == "high"
        created, deadline = map(datetime.fromisoformat, (job["created"], job["deadline"]))
        assert round((deadline - created).total_seconds()) == 600

    @pytest.mark.parametrize(
        ("handling", "words"),
        [
            ('{"priority": "first"}', "priority: Input should be 'high', 'normal' or 'low'."),
            ('{"speed": 2}', "speed: this name is not known."),
            ('{"deadline_seconds": 0}', "deadline_seconds: Input should be greater than 0."),
        ],
    )
    def test_that_cannot_be_is_refused(
        self, handling: str, words: str, http: httpx.Client, png: Png
    ) -> None:
        answer = post_pair(http, png(64, 48), png(64, 48, True), data={"handling": handling})
        assert problem_of(answer) == (422, "invalid-option", words)


class TestCameras:
    """Jobs may have the service open what its operator allows, and no other host or port."""

    @pytest.fixture
    def settings(self, settings: Settings) -> Settings:
        allowed = "sim://studio ptp+ip://10.0.0.7 gphoto2://usb"
        return settings.model_copy(update={"cameras": allowed})

    @pytest.mark.parametrize(
        "address",
        [
            "sim://studio",
            "sim://studio?lights=3",
            "ptp+ip://10.0.0.7",
            "ptp+ip://10.0.0.7:15741",
            "gphoto2://usb:001,004",
        ],
    )
    def test_an_allowed_one_is_taken(self, address: str, http: httpx.Client) -> None:
        answer = http.post("/jobs", json={"capture": {"camera": address}})
        assert answer.status_code == 202

    @pytest.mark.parametrize(
        "address", ["ptp+ip://10.0.0.70", "ptp+ip://10.0.0.7.evil.example", "ptp+usb://123"]
    )
    def test_another_one_is_not(self, address: str, http: httpx.Client, context: Context) -> None:
        answer = http.post("/jobs", json={"capture": {"camera": address}})
        status, kind, sentence = problem_of(answer)
        assert (status, kind) == (403, "foreign-camera") and "LIGHTLAYERS_CAMERAS" in sentence
        assert rows_of(context) == []


@pytest.mark.parametrize("address", ["ptp+ip://127.0.0.1:22", "gphoto2://ptpip:127.0.0.1:22"])
def test_nobody_has_the_service_knock_at_ports(address: str, http: httpx.Client) -> None:
    answer = http.post("/jobs", json={"capture": {"camera": address}})
    assert problem_of(answer)[:2] == (403, "foreign-camera")

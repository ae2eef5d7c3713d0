from __future__ import annotations

import json
import socket
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import httpx
import pytest
from fastapi import FastAPI

from drivers import SettingName, SettingValue
from pipeline.options import Options
from service.api import accept_pair
from service.api.context import Context
from service.api.idempotency import hash_of, hash_of_mix
from service.api.intake import Intake
from service.api.models import Handling
from service.capture import Capture
from service.mixing import MixOptions
from service.rows import cameras, jobs
from tests.unit.service.asking import post_capture, post_pair, problem_of, rows_of, stored_job

Png = Callable[..., bytes]


def test_an_idempotency_key_gives_the_same_job_again(
    http: httpx.Client, png: Png, context: Context
) -> None:
    headers = {"idempotency-key": "once"}
    first = post_pair(http, png(64, 48), png(64, 48, True), headers=headers)
    again = post_pair(http, png(64, 48), png(64, 48, True), headers=headers)
    assert (again.status_code, again.json()["id"]) == (202, first.json()["id"])
    assert again.json() == first.json()
    assert again.headers["location"] == first.headers["location"]
    assert again.headers["idempotency-replayed"] == "true"
    assert "idempotency-replayed" not in first.headers
    assert len(http.get("/jobs").json()["jobs"]) == 1
    assert len(context.storage.list("")) == 2


def test_requests_with_one_key_that_come_at_once_make_one_job(
    http: httpx.Client, png: Png, context: Context
) -> None:
    def send(_number: int) -> httpx.Response:
        headers = {"idempotency-key": "once"}
        return post_pair(http, png(64, 48), png(64, 48, True), headers=headers)

    with ThreadPoolExecutor(4) as pool:
        answers = list(pool.map(send, range(4)))
    assert [answer.status_code for answer in answers] == [202] * 4
    assert len({answer.headers["location"] for answer in answers}) == 1
    replayed = [answer.headers.get("idempotency-replayed", "no") for answer in answers]
    assert sorted(replayed) == ["no", "true", "true", "true"]
    assert [job.id for job in rows_of(context)] == [answers[0].json()["id"]]
    assert len(context.storage.list("")) == 2


def test_a_key_whose_upload_broke_off_is_as_new(
    http: httpx.Client, png: Png, context: Context
) -> None:
    head = "POST /jobs HTTP/1.1\r\nHost: localhost\r\nContent-Length: 90000\r\n"
    head += "Idempotency-Key: once\r\nContent-Type: multipart/form-data; boundary=edge\r\n\r\n"
    with socket.create_connection((http.base_url.host, http.base_url.port or 80)) as client:
        client.sendall(f"{head}--edge\r\n".encode())
    headers = {"idempotency-key": "once"}
    assert problem_of(post_pair(http, b"no picture", png(64, 48), headers=headers))[0] == 422
    answer = post_pair(http, png(64, 48), png(64, 48, True), headers=headers)
    assert (answer.status_code, "idempotency-replayed" in answer.headers) == (202, False)
    assert [job.id for job in rows_of(context)] == [answer.json()["id"]]


def test_the_key_of_a_deleted_job_is_as_new(http: httpx.Client) -> None:
    first = post_capture(http, **{"idempotency-key": "once"})
    http.delete(first["links"]["self"])
    second = post_capture(http, **{"idempotency-key": "once"})
    assert second["id"] != first["id"]


def test_a_job_that_is_deleted_while_its_key_is_sent_again_asks_for_another_try(
    http: httpx.Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    post_capture(http, **{"idempotency-key": "once"})
    monkeypatch.setattr(jobs, "find_by_key", lambda _connection, _owner, _key: None)
    wanted = {"capture": {"camera": "sim://studio"}}
    answer = http.post("/jobs", json=wanted, headers={"idempotency-key": "once"})
    assert (answer.status_code, answer.json()["retryable"]) == (503, True)


@pytest.mark.parametrize("way", ["a pair", "a rerun", "a camera's capture", "a burst"])
def test_a_request_that_settings_have_come_to_forbid_gives_its_job_again(
    way: str,
    http: httpx.Client,
    context: Context,
    server: tuple[FastAPI, str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(accept_pair, "_check", lambda *_photographs: None)
    webhook = {"url": "http://example.org/done", "secret": "whsec_" + "a" * 32}
    camera = {"camera": "sim://studio"}
    source = post_capture(http)["id"] if way == "a burst" else stored_job(context)

    def send(headers: dict[str, str]) -> httpx.Response:
        handling: dict[str, Any] = {"webhook": webhook}
        if way == "a pair":
            data = {"handling": json.dumps(handling)}
            return post_pair(http, b"no flash", b"flash", headers=headers, data=data)
        ways: dict[str, tuple[str, dict[str, Any]]] = {
            "a rerun": (f"/jobs/{source}/rerun", {}),
            "a camera's capture": ("/jobs", {"capture": camera}),
            "a burst": (f"/cameras/{cameras.id_of('sim://studio')}/captures", {"pairs": 2}),
        }
        path, body = ways[way]
        return http.post(path, json=body | handling, headers=headers)

    first = send({"idempotency-key": "once"})
    narrow = {"webhook_https": True, "cameras": "ptp+usb://"}
    settings = context.settings.model_copy(update=narrow)
    server[0].state.context = replace(context, settings=settings)
    again = send({"idempotency-key": "once"})
    assert (first.status_code, again.status_code) == (202, 202)
    assert again.headers["location"] == first.headers["location"]
    assert problem_of(send({"idempotency-key": "another"}))[0] in (403, 422)


class _LaterOptions(Options):
    tuned: bool = False


class _LaterHandling(Handling):
    tuned: bool = False


class _LaterCapture(Capture):
    tuned: bool = False


def test_what_a_later_release_adds_leaves_an_earlier_request_the_same() -> None:
    camera = "sim://studio"
    wanted = Intake(Options(lights=2), Handling(), Path(), capture=Capture(camera=camera))
    later = Intake(
        _LaterOptions(lights=2), _LaterHandling(), Path(), capture=_LaterCapture(camera=camera)
    )
    assert hash_of(later) == hash_of(wanted)
    for change in (
        {"options": _LaterOptions(lights=2, tuned=True)},
        {"handling": _LaterHandling(tuned=True)},
        {"capture": _LaterCapture(camera=camera, tuned=True)},
    ):
        assert hash_of(replace(later, **change)) != hash_of(wanted)


def test_a_mix_that_an_earlier_release_made_is_given_again() -> None:
    """By the digest that its row has, which was that of a job without a pair."""
    mix = {"lamps": [{"ev": 1}, {"neutral": True}], "format": "tiff"}
    options = MixOptions.model_validate({"kind": "mix", "of": "a", "mix": mix})
    assert hash_of_mix(options, Handling(priority="high")) == (
        "782882c10d27e248342e20fa5e998e806a69fb9cdbfc4e2e8ecda13ab1bb6e55"
    )
    assert hash_of_mix(options, Handling()) != hash_of_mix(options, Handling(priority="high"))


def test_a_default_that_is_named_is_asked_for() -> None:
    none, named = Options(), Options(flash_spectrum="xenon")
    assert none == named
    assert len({hash_of(Intake(one, Handling(), Path())) for one in (none, named)}) == 2


def test_a_request_is_known_by_its_calibrations_and_not_by_the_order_of_its_settings() -> None:
    def asked(*names: str, flash: str = "1" * 32) -> str:
        settings: dict[SettingName, SettingValue] = {SettingName(name): 8 for name in names}
        capture = Capture(camera="sim://studio", settings=settings)
        named = {"flash_calibration": flash}
        return hash_of(Intake(Options(), Handling(), Path(), capture=capture, calibrations=named))

    assert asked("f_number", "iso") == asked("iso", "f_number")
    assert asked("iso") != asked("iso", flash="2" * 32)


@pytest.mark.parametrize("change", ["options", "one photograph", "both photographs", "capture"])
def test_an_idempotency_key_is_for_one_request(
    change: str, http: httpx.Client, png: Png, context: Context
) -> None:
    headers = {"idempotency-key": "once"}
    first = post_pair(http, png(64, 48), png(64, 48, True), headers=headers)
    other = http.post("/jobs", headers=headers, **_other_request(change, png))
    assert problem_of(other)[:2] == (422, "idempotency-key-reused")
    assert [job["id"] for job in http.get("/jobs").json()["jobs"]] == [first.json()["id"]]
    assert len(context.storage.list("")) == 2


def test_another_cameras_capture_is_another_request(http: httpx.Client) -> None:
    headers = {"idempotency-key": "once"}
    post_capture(http, **headers)
    wanted = {"capture": {"camera": "sim://studio?lights=3"}}
    other = http.post("/jobs", json=wanted, headers=headers)
    assert problem_of(other)[:2] == (422, "idempotency-key-reused")


def _other_request(change: str, png: Png) -> dict[str, Any]:
    files = {"no_flash": ("a", png(64, 48)), "flash": ("b", png(64, 48, True))}
    others: dict[str, dict[str, Any]] = {
        "options": {"files": files, "data": {"options": '{"lights": 1}'}},
        "one photograph": {"files": {**files, "flash": ("b", png(64, 48, True) + b"\0")}},
        "both photographs": {"files": {"no_flash": files["flash"], "flash": files["no_flash"]}},
        "capture": {"json": {"capture": {"camera": "sim://studio"}}},
    }
    return others[change]

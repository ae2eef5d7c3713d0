"""JSON is taken at its word, wherever it comes: "2" is no number, and 1 is no yes."""

from __future__ import annotations

import json
from typing import Any

import httpx
import pytest

from service.api.context import Context
from service.settings import Settings
from tests.unit.service.asking import post_pair, problem_of, rows_of, stored_job
from tests.unit.service.studio import PATH, SIM, with_cameras

CAMERA = {"camera": SIM}
NUMBER = "Input should be a valid number."
YES_OR_NO = "Input should be a valid boolean."


@pytest.fixture
def settings(settings: Settings) -> Settings:
    return with_cameras(settings)


@pytest.mark.parametrize(
    ("path", "body", "place", "told"),
    [
        ("/jobs", {"capture": CAMERA, "deadline_seconds": "600"}, "deadline_seconds", NUMBER),
        ("/jobs", {"capture": CAMERA, "deadline_seconds": True}, "deadline_seconds", NUMBER),
        ("/jobs", {"capture": CAMERA | {"keep": "no"}}, "capture.keep", YES_OR_NO),
        ("/jobs", {"capture": CAMERA, "options": {"focal_px": "9"}}, "options.focal_px", NUMBER),
        ("/jobs", {"capture": CAMERA, "options": {"align": 1}}, "options.align", YES_OR_NO),
        (f"{PATH}/captures", {"pairs": "2"}, "pairs", "Input should be a valid integer."),
        (f"{PATH}/captures", {"interval_seconds": "2"}, "interval_seconds", NUMBER),
        ("/jobs/{job}/mix", {"lamps": [{"ev": "1"}]}, "lamp 1, ev", NUMBER),
        ("/jobs/{job}/mix", {"lamps": [{"on": "off"}]}, "lamp 1, on", YES_OR_NO),
        ("/jobs/{job}/rerun", {"deadline_seconds": "600"}, "deadline_seconds", NUMBER),
        ("/jobs/{job}/rerun", {"options": {"focal_px": "9"}}, "focal_px", NUMBER),
    ],
)
def test_text_is_no_number_in_a_body(
    path: str, body: dict[str, Any], place: str, told: str, http: httpx.Client, context: Context
) -> None:
    job = stored_job(context)
    answer = http.post(path.format(job=job), json=body)
    assert problem_of(answer) == (422, "invalid-option", f"{place}: {told}")
    assert [row.id for row in rows_of(context)] == [job]


@pytest.mark.parametrize(
    ("part", "value", "told"),
    [
        ("handling", {"deadline_seconds": "600"}, f"deadline_seconds: {NUMBER}"),
        ("options", {"focal_px": "9"}, f"focal_px: {NUMBER}"),
    ],
)
def test_text_is_no_number_in_a_form(
    part: str, value: dict[str, Any], told: str, http: httpx.Client, context: Context
) -> None:
    answer = post_pair(http, b"a", b"b", data={part: json.dumps(value)})
    assert problem_of(answer) == (422, "invalid-option", told)
    assert rows_of(context) == []


def test_a_whole_number_is_a_number(http: httpx.Client) -> None:
    body = {"capture": CAMERA, "deadline_seconds": 600, "options": {"focal_px": 900, "lights": 2}}
    made = http.post("/jobs", json=body).raise_for_status().json()
    assert made["options"] == {"focal_px": 900.0, "lights": 2}


NUL = "A text holds a NUL (\\u0000), which cannot be kept: leave it out."


@pytest.mark.parametrize(
    ("path", "body"),
    [
        ("/jobs", {"capture": CAMERA | {"settings": {"white_balance": "a\0"}}}),
        ("/jobs", {"capture": CAMERA, "options": {"flash_spectrum": "\0"}}),
        ("/calibrations", {"capture": CAMERA, "options": {"kind": "flash", "setup": "a\0b"}}),
        (f"{PATH}/captures", {"settings": {"white_balance": "\\\0"}}),
        ("/jobs/{job}/mix", {"lamps": [], "\0": 1}),
        ("/jobs/{job}/rerun", {"options": {"flash_spectrum": "\0"}}),
    ],
)
def test_a_nul_is_refused(
    path: str, body: dict[str, Any], http: httpx.Client, context: Context
) -> None:
    job = stored_job(context)
    answer = http.post(path.format(job=job), json=body)
    assert problem_of(answer) == (422, "invalid-option", NUL)
    assert [row.id for row in rows_of(context)] == [job]


@pytest.mark.parametrize("part", ["handling", "options"])
def test_a_nul_is_refused_in_a_form(part: str, http: httpx.Client, context: Context) -> None:
    answer = post_pair(http, b"a", b"b", data={part: json.dumps({"x": "\0"})})
    assert problem_of(answer) == (422, "invalid-option", NUL)
    assert rows_of(context) == []


def test_a_backslash_before_the_digits_of_a_nul_is_none(http: httpx.Client) -> None:
    body = {"capture": CAMERA | {"settings": {"white_balance": "a\\u0000"}}}
    made = http.post("/jobs", json=body).raise_for_status().json()
    assert made["capture"]["settings"] == {"white_balance": "a\\u0000"}


def test_a_name_of_a_calibration_that_goes_deep_is_no_name(http: httpx.Client) -> None:
    deep = "[" * 980 + "]" * 980
    for option in ("camera", "flash_spectrum"):
        options = f'{{"{option}": {{"calibration": {deep}}}}}'
        body = f'{{"capture": {json.dumps(CAMERA)}, "options": {options}}}'
        answer = http.post("/jobs", content=body, headers={"content-type": "application/json"})
        status, kind, told = problem_of(answer)
        assert (status, kind) == (422, "invalid-option")
        assert told.startswith("Invalid JSON: recursion limit exceeded")

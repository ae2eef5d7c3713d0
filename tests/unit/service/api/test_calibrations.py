from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from typing import Any

import httpx
import pytest

from pipeline.options import Options, Sensitivities, Spectrum
from pipeline.spectra.tables import write_sensitivities, write_spectrum
from pipeline.taken_with import TakenWith
from service.api.context import Context
from service.rows import cameras, jobs, kept, tables
from tests.unit.service.asking import ended_while_waiting, problem_of
from tests.unit.service.studio import ask_in_process

Png = Callable[..., bytes]
Finish = Callable[[str, dict[str, bytes]], None]

CIRCLE = {"x": 20, "y": 20, "radius": 5}
CHART = [[5, 5], [55, 5], [55, 40], [5, 40]]
LIGHTS: list[dict[str, Any]] = [
    {"direction": [0.0, 0.6, 0.8]},
    {"direction": [0.8, 0.0, 0.6], "strength": 0.5},
]
NM = [400.0, 500.0, 700.0]
TABLES = {
    "flash": write_spectrum(Spectrum(wavelength_nm=NM, power=[1.0, 2.0, 1.0])),
    "camera": write_sensitivities(
        Sensitivities(wavelength_nm=NM, r=[0.0, 0.2, 1.0], g=[0.1, 1.0, 0.2], b=[1.0, 0.3, 0.0])
    ),
    "lamps": json.dumps({"lights": LIGHTS}).encode(),
}
OPTIONS: dict[str, dict[str, Any]] = {
    "flash": {"kind": "flash", "card": CIRCLE},
    "camera": {"kind": "camera", "chart": CHART},
    "lamps": {"kind": "lamps", "sphere": CIRCLE},
}
FILES = {"flash": "flash.json", "camera": "camera.json", "lamps": "lights.json"}


@pytest.fixture(autouse=True)
def _no_processes(monkeypatch: pytest.MonkeyPatch) -> None:
    ask_in_process(monkeypatch)


@pytest.fixture
def post(http: httpx.Client, png: Png) -> Callable[..., httpx.Response]:
    """Send a pair with these options: post(path, options)."""

    def send(path: str, options: Any, **headers: str) -> httpx.Response:
        files = {"no_flash": ("a", png(64, 48)), "flash": ("b", png(64, 48, True))}
        return http.post(path, files=files, data={"options": json.dumps(options)}, headers=headers)

    return send


@pytest.fixture
def calibrated(post: Callable[..., httpx.Response], finish: Finish) -> Callable[[str], str]:
    """Id of a finished calibration of a kind."""

    def make(kind: str) -> str:
        job: dict[str, str] = post("/calibrations", OPTIONS[kind]).json()
        finish(job["id"], {FILES[kind]: TABLES[kind], "manifest.json": b"{}"})
        return job["id"]

    return make


def test_a_calibration_may_be_waited_for(
    http: httpx.Client, post: Callable[..., httpx.Response], finish: Finish
) -> None:
    made, answer = ended_while_waiting(
        http, finish, lambda: post("/calibrations", OPTIONS["flash"], prefer="wait=60")
    )

    assert (answer.status_code, answer.json()["id"]) == (202, made)
    assert answer.json()["state"] == "succeeded"
    assert answer.headers["preference-applied"] == "wait=60"


@pytest.mark.parametrize("kind", OPTIONS)
def test_a_calibration_becomes_a_queued_job(
    post: Callable[..., httpx.Response], http: httpx.Client, context: Context, kind: str
) -> None:
    answer = post("/calibrations", OPTIONS[kind])
    assert answer.status_code == 202, answer.text
    job = answer.json()
    assert answer.headers["location"] == f"/jobs/{job['id']}" == job["links"]["self"]
    assert job["state"] == "queued"
    assert job["options"]["kind"] == kind
    assert http.get(f"/jobs/{job['id']}").json() == job
    with context.engine.connect() as connection:
        row = jobs.find(connection, job["id"])
    assert row is not None and row.task == "calibrate"


def test_a_separation_is_another_task(
    post: Callable[..., httpx.Response], context: Context
) -> None:
    job = post("/jobs", {"lights": 2}).json()
    with context.engine.connect() as connection:
        row = jobs.find(connection, job["id"])
    assert row is not None and row.task == "separate"


def test_sending_twice_with_a_key_makes_one_job(post: Callable[..., httpx.Response]) -> None:
    key = {"Idempotency-Key": "once"}
    first, again = (post("/calibrations", OPTIONS["lamps"], **key).json() for _ in range(2))
    assert first["id"] == again["id"]
    other = post("/calibrations", OPTIONS["flash"], **key)
    assert (other.status_code, other.json()["type"][-22:]) == (422, "idempotency-key-reused")


@pytest.mark.parametrize(
    ("options", "status", "words"),
    [
        ({"kind": "lens"}, 422, "'flash', 'camera', 'lamps'"),
        ({**OPTIONS["flash"], "chart": CHART}, 422, "mark either a grey card or a ColorChecker"),
        ({"kind": "lamps", "sphere": {**CIRCLE, "radius": -1}}, 422, "greater than 0"),
        ({"kind": "camera", "chart": CHART[:2]}, 422, "chart"),
        ([1], 422, "object"),
    ],
)
def test_bad_options_are_refused(
    post: Callable[..., httpx.Response], options: Any, status: int, words: str
) -> None:
    answer = post("/calibrations", options)
    assert answer.status_code == status
    assert words in answer.json()["detail"]


def test_bad_requests_are_refused(http: httpx.Client, png: Png) -> None:
    files: dict[str, Any] = {
        "no_flash": ("a", png(64, 48)),
        "flash": ("b", png(64, 48, True)),
    }
    without = http.post("/calibrations", files=files)
    assert (without.status_code, without.json()["detail"]) == (
        400,
        "The part options is missing; it says what to calibrate.",
    )
    as_json = http.post("/calibrations", json=OPTIONS["flash"])
    assert (as_json.status_code, as_json.json()["detail"]) == (
        422,
        "Name the pair: `uploads` for photographs that are sent, or `capture` for a camera.",
    )
    as_text = http.post("/calibrations", content=b"x", headers={"content-type": "text/plain"})
    assert (as_text.status_code, as_text.json()["title"]) == (415, "Neither multipart nor JSON")
    files["flash"] = ("b", b"no picture")
    options = {"options": json.dumps(OPTIONS["flash"])}
    assert http.post("/calibrations", files=files, data=options).status_code == 422


def test_a_job_is_filled_in_from_calibrations(
    post: Callable[..., httpx.Response], calibrated: Callable[[str], str], http: httpx.Client
) -> None:
    ids = {kind: calibrated(kind) for kind in OPTIONS}
    asked: dict[str, Any] = {
        "camera": {"calibration": ids["camera"]},
        "response": {"calibration": ids["camera"]},
        "flash_spectrum": {"calibration": ids["flash"]},
        "neutral": {"calibration": ids["flash"]},
        "light_directions": {"calibration": ids["lamps"]},
    }
    job = post("/jobs", asked).json()
    kept = job["options"]
    assert kept["flash_spectrum"] == {"wavelength_nm": NM, "power": [1.0, 2.0, 1.0]}
    assert (kept["neutral"], kept["response"]) == (kept["flash_spectrum"], kept["camera"])
    assert (kept["camera"]["g"], kept["camera"]["r"]) == ([0.1, 1.0, 0.2], [0.0, 0.2, 1.0])
    for name in ("direction", "strength"):
        found = [light.get(name) for light in kept["light_directions"]]
        assert found == [light.get(name) for light in LIGHTS]
    # the row is complete: nothing changes when the calibration goes
    assert http.delete(f"/jobs/{ids['camera']}").status_code == 204
    assert http.get(f"/jobs/{job['id']}").json()["options"] == kept


@pytest.mark.parametrize(
    ("kind", "option"),
    [("camera", "camera"), ("flash", "flash_spectrum"), ("lamps", "light_directions")],
)
def test_a_job_says_what_its_calibration_was_found_with(
    post: Callable[..., httpx.Response], finish: Finish, http: httpx.Client, kind: str, option: str
) -> None:
    taken_with = TakenWith(make="NIKON", model="D5100", encoding="raw", upright=True)
    content = json.loads(TABLES[kind])
    for saved in content["lights"] if kind == "lamps" else [content]:
        saved["taken_with"] = taken_with.model_dump()
    made = post("/calibrations", OPTIONS[kind]).json()["id"]
    finish(made, {FILES[kind]: json.dumps(content).encode(), "manifest.json": b"{}"})

    job = post("/jobs", {option: {"calibration": made}}).json()
    again = http.post(f"/jobs/{job['id']}/rerun", json={}).json()

    for one in (job, again):
        Options.model_validate(one["options"])
        filled = one["options"][option]
        said = [value["taken_with"] for value in (filled if kind == "lamps" else [filled])]
        assert {TakenWith.model_validate(value) for value in said} == {taken_with}


def test_a_calibration_that_has_succeeded_answers_what_it_was_found_with(
    post: Callable[..., httpx.Response], finish: Finish, http: httpx.Client, context: Context
) -> None:
    taken_with = TakenWith(make="NIKON", model="D5100", upright=False, orientation=3)
    made = post("/calibrations", OPTIONS["lamps"]).json()
    assert made["taken_with"] is None
    with context.engine.begin() as connection:  # as the worker notes it
        row = jobs.find(connection, made["id"])
        assert row is not None and row.inputs is not None
        inputs = kept.with_camera(row.inputs, taken_with.model_dump())
        table = tables.jobs
        connection.execute(table.update().where(table.c.id == row.id).values(inputs=inputs))
    finish(made["id"], {FILES["lamps"]: TABLES["lamps"]})
    separation = post("/jobs", {}).json()
    finish(separation["id"], {"manifest.json": b"{}"})

    ended = http.get(f"/jobs/{made['id']}").json()

    assert ended["taken_with"] == taken_with.model_dump()
    assert ended["inputs"] == made["inputs"]
    assert http.get(f"/jobs/{separation['id']}").json()["taken_with"] is None


def test_what_no_calibration_says_is_refused(post: Callable[..., httpx.Response]) -> None:
    lights = [{**light, "taken_with": {"orientation": 9}} for light in LIGHTS]
    answer = post("/jobs", {"light_directions": lights})
    assert problem_of(answer)[:2] == (422, "invalid-option")
    assert "orientation" in answer.json()["detail"]


def test_captures_and_calibrations_take_calibrations(
    http: httpx.Client,
    post: Callable[..., httpx.Response],
    calibrated: Callable[[str], str],
) -> None:
    camera = {"camera": {"calibration": calibrated("camera")}}
    wanted = {"capture": {"camera": "sim://studio"}, "options": camera}
    assert http.post("/jobs", json=wanted).json()["options"]["camera"]["wavelength_nm"] == NM
    flash = post("/calibrations", {**OPTIONS["flash"], **camera}).json()
    assert flash["options"]["camera"]["b"] == [1.0, 0.3, 0.0]


def test_outputs_that_need_a_response_take_it_from_a_calibration(
    post: Callable[..., httpx.Response], calibrated: Callable[[str], str]
) -> None:
    outputs = {"outputs": ["response.jpg"]}
    assert post("/jobs", outputs).status_code == 422
    response = {"response": {"calibration": calibrated("camera")}}
    assert post("/jobs", {**outputs, **response}).json()["options"]["response"]["r"] == [0, 0.2, 1]


def test_what_a_calibration_found_is_judged_as_a_table_is(
    post: Callable[..., httpx.Response], finish: Finish
) -> None:
    lamps = post("/calibrations", OPTIONS["lamps"]).json()["id"]
    finish(lamps, {FILES["lamps"]: json.dumps({"lights": LIGHTS[:1]}).encode()})
    answer = post("/jobs", {"light_directions": {"calibration": lamps}})
    assert problem_of(answer) == (
        422,
        "invalid-option",
        "light_directions: List should have at least 2 items, not 1.",
    )


@pytest.mark.parametrize(
    ("found", "pinned", "words"),
    [
        (2, ["A", "D65"], None),
        (3, ["A", "D65"], None),
        (3, ["A", "D65", "FL2"], None),
        (2, ["A", "D65", "FL2"], "3 lamps are pinned and only 2 asked for"),
    ],
)
def test_as_many_lamps_are_pinned_as_a_calibration_has(
    post: Callable[..., httpx.Response],
    finish: Finish,
    found: int,
    pinned: list[str],
    words: str | None,
) -> None:
    lamps = post("/calibrations", OPTIONS["lamps"]).json()["id"]
    lights = [*LIGHTS, {"direction": [-0.6, 0.0, 0.8]}][:found]
    finish(lamps, {FILES["lamps"]: json.dumps({"lights": lights}).encode()})
    answer = post("/jobs", {"light_directions": {"calibration": lamps}, "pinned_lamps": pinned})
    if words is None:
        assert (answer.status_code, len(answer.json()["options"]["light_directions"])) == (
            202,
            found,
        )
    else:
        assert problem_of(answer)[:2] == (422, "invalid-option")
        assert words in answer.json()["detail"]


@pytest.fixture
def requests(
    http: httpx.Client, post: Callable[..., httpx.Response]
) -> dict[str, Callable[..., httpx.Response]]:
    """Ways to ask for a job with options and headers."""
    camera = http.get("/cameras").json()[0]["id"]

    def send(path: str, options: Any, headers: dict[str, str], **more: Any) -> httpx.Response:
        return http.post(path, json={**more, "options": options}, headers=headers)

    return {
        "pair": lambda options, headers: post("/jobs", options, **headers),
        "capture": partial(send, "/jobs", capture={"camera": "sim://studio"}),
        "burst": partial(send, f"/cameras/{camera}/captures"),
    }


@pytest.mark.parametrize("way", ["pair", "capture", "burst"])
def test_a_key_gives_the_job_after_its_calibration_is_gone(
    requests: dict[str, Callable[..., httpx.Response]],
    calibrated: Callable[[str], str],
    http: httpx.Client,
    way: str,
) -> None:
    ask, headers = requests[way], {"idempotency-key": "once"}
    flash, other = calibrated("flash"), calibrated("flash")
    options = {"flash_spectrum": {"calibration": flash}}
    first = ask(options, headers)
    assert first.status_code == 202, first.text
    http.delete(f"/jobs/{flash}").raise_for_status()
    again = ask(options, headers)
    assert (again.status_code, again.json()) == (202, first.json())
    assert again.headers["idempotency-replayed"] == "true"
    for name in (flash, other):
        changed = {**options, "neutral": {"calibration": name}}
        assert problem_of(ask(changed, headers))[:2] == (422, "idempotency-key-reused")
    assert problem_of(ask(options, {}))[:2] == (422, "invalid-option")


def test_calibrations_that_cannot_be_used_are_named(
    post: Callable[..., httpx.Response], calibrated: Callable[[str], str], http: httpx.Client
) -> None:
    canceled = post("/calibrations", OPTIONS["camera"]).json()["id"]
    http.post(f"/jobs/{canceled}/cancel")
    separation = post("/jobs", {}).json()["id"]
    flash = calibrated("flash")
    for named, words in {
        "0123": "camera: there is no calibration '0123'; it may have been deleted.",
        40 * "1": f"camera: there is no calibration '{32 * '1'}'; it may have been deleted.",
        separation: f"camera: there is no calibration {separation!r}; it may have been deleted.",
        flash: "camera: the calibration is one of a flash, and this takes one of a camera.",
        canceled: "camera: the calibration is canceled; make another.",
    }.items():
        answer = post("/jobs", {"camera": {"calibration": named}})
        assert (answer.status_code, answer.json()["detail"]) == (422, words)


def test_a_calibration_that_has_not_ended_may_be_named_later(
    post: Callable[..., httpx.Response], finish: Finish
) -> None:
    waiting = post("/calibrations", OPTIONS["flash"]).json()["id"]
    named = {"flash_spectrum": {"calibration": waiting}}
    early = post("/jobs", named)
    words = "flash_spectrum: the calibration is queued; wait until it has succeeded."
    assert problem_of(early) == (409, "not-ready", words)
    assert early.json()["retryable"]
    finish(waiting, {FILES["flash"]: TABLES["flash"]})
    assert post("/jobs", named).status_code == 202


def test_an_id_that_no_database_takes_is_none_of_a_calibration(
    http: httpx.Client, post: Callable[..., httpx.Response]
) -> None:
    http.get("/cameras").raise_for_status()
    captures = f"/cameras/{cameras.id_of('sim://studio')}/captures"
    wanted = {"camera": {"calibration": "\ud800"}}
    of_flash = OPTIONS["flash"] | wanted

    def post_json(path: str, **body: Any) -> httpx.Response:
        headers = {"content-type": "application/json"}
        return http.post(path, content=json.dumps(body), headers=headers)

    for answer in (
        post("/jobs", wanted),
        post("/calibrations", of_flash),
        post_json("/jobs", capture={"camera": "sim://studio"}, options=wanted),
        post_json("/calibrations", capture={"camera": "sim://studio"}, options=of_flash),
        post_json(captures, options=wanted),
    ):
        assert problem_of(answer) == (
            422,
            "invalid-option",
            r"camera: there is no calibration '\ud800'; it may have been deleted.",
        )


def test_other_objects_are_judged_as_tables(post: Callable[..., httpx.Response]) -> None:
    for camera in ({"calibration": "1", "r": [1]}, {"name": "x"}, {"calibration": {"id": 1}}):
        answer = post("/jobs", {"camera": camera})
        assert answer.status_code == 422
        assert "camera" in answer.json()["detail"]

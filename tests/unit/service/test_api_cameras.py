"""The routes of cameras; what they ask of a camera is done in this process."""

from __future__ import annotations

import contextlib
import errno
import json
from collections.abc import Iterator
from typing import Any

import httpx
import pytest

import drivers
from service import camera_tasks, cameras, jobs, sandbox
from service.api.context import Context
from service.api.looking import Looking
from service.errors import StorageFullError
from service.errors import problem_of as problem
from service.settings import Settings
from tests.unit.service.asking import bearing, owner_of, problem_of, rows_of
from tests.unit.service.streams import events

SIM = "sim://studio?width=64&height=64"
AWAY = "ptp+ip://127.0.0.1:1"
FOREIGN = "ptp+ip://192.168.1.99"
PATH = f"/cameras/{cameras.id_of(SIM)}"


@pytest.fixture
def settings(settings: Settings) -> Settings:
    """Those of a service with a simulated camera and one that is switched off."""
    return settings.model_copy(update={"cameras": f"{SIM} {AWAY}", "queued_jobs_per_key": 10})


@pytest.fixture(autouse=True)
def _no_processes(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    work = {
        "cameras": camera_tasks.find,
        "camera": camera_tasks.describe,
        "camera_settings": camera_tasks.adjust,
    }

    def run(_looking: Looking, kind: str, capture: Any, trace_id: str = "") -> Any:
        told: list[dict[str, Any]] = []
        try:
            work[kind]({"capture": capture}, told.append)
        except drivers.DriverError as error:
            raise sandbox.TaskError(problem(error, trace_id).model_dump()) from error
        return json.loads(json.dumps(told[-1]["answer"]))

    monkeypatch.setattr(Looking, "_run", run)
    yield


@pytest.fixture
def capture(http: httpx.Client) -> Any:
    """Ask the simulated camera for pairs."""
    http.get("/cameras").raise_for_status()
    return lambda **wanted: http.post(f"{PATH}/captures", json=wanted)


def _hold(context: Context, job_id: str) -> jobs.Job:
    with context.engine.begin() as connection:
        held = cameras.claim(connection, job_id, "w")
    assert held is not None
    return held


def _take(context: Context, job_id: str, settings: dict[str, Any]) -> None:
    """Do a worker's part: take the pair of a job."""
    held = _hold(context, job_id)
    inputs = {frame: {"key": frame, "sha256": "0" * 64} for frame in ("no_flash", "flash")}
    with context.engine.begin() as connection:
        assert jobs.set_inputs(connection, held, inputs, 2, settings)
        assert jobs.release(connection, held)


class TestList:
    def test_cameras_are_listed_that_are_there_and_that_are_not(self, http: httpx.Client) -> None:
        away, here = http.get("/cameras").raise_for_status().json()
        assert here == {
            "id": cameras.id_of(SIM),
            "address": SIM,
            "make": "NIKON CORPORATION",
            "model": "NIKON D5100",
            "serial": "0000001",
            "state": "idle",
            "battery_percent": 87,
            "free_bytes": 2 * 10**9,
            "holder": None,
            "waiting": 0,
        }
        assert (away["address"], away["state"], away["model"]) == (AWAY, "away", "")
        assert (away["battery_percent"], away["free_bytes"]) == (None, None)

    @pytest.mark.parametrize("allowed", [AWAY, "ptp+ip://"])
    def test_announcements_are_listened_to_where_all_cameras_of_the_network_are_allowed(
        self, context: Context, allowed: str, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        asked: list[Any] = []

        def run(_looking: Looking, kind: str, wanted: Any) -> list[str]:
            asked.append((kind, wanted))
            if kind == "cameras":
                return []
            raise drivers.CameraNotFoundError("away")

        monkeypatch.setattr(Looking, "_run", run)
        settings = context.settings.model_copy(update={"cameras": allowed})
        with contextlib.closing(Looking(context.engine, settings, context.fork_server)) as looking:
            looking.refresh(60)
        assert asked[0] == ("cameras", {"network": allowed == "ptp+ip://"})

    @pytest.mark.parametrize(
        "error", [OSError(errno.ENOSPC, "full"), StorageFullError("The disk is full.")]
    )
    def test_a_full_disk_leaves_looks_unanswered(
        self, error: Exception, http: httpx.Client, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def run(*_arguments: object) -> None:
            raise error

        monkeypatch.setattr(Looking, "_run", run)
        shown = http.get("/cameras").raise_for_status().json()
        assert {one["address"]: one["state"] for one in shown} == {SIM: "away", AWAY: "away"}

    def test_a_camera_that_another_process_saw_just_now_is_left_alone(
        self, http: httpx.Client, context: Context, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        http.get("/cameras").raise_for_status()
        looked: list[str] = []

        def run(_looking: Looking, kind: str, _wanted: Any) -> list[str]:
            looked.append(kind)
            return []

        monkeypatch.setattr(Looking, "_run", run)
        with contextlib.closing(
            Looking(context.engine, context.settings, context.fork_server)
        ) as other:
            other.refresh(60)
        assert looked == ["cameras"]
        assert http.get("/cameras").json()[1]["state"] == "idle"

    def test_a_camera_that_a_job_has_is_told_as_it_was(
        self, http: httpx.Client, capture: Any, context: Context, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        first, second = (capture().json()["jobs"][0]["id"] for _ in range(2))
        held = _hold(context, first)

        def opened(*_arguments: object) -> None:
            pytest.fail("a camera was opened that a job has")

        monkeypatch.setattr("service.api.looking._FRESH_SECONDS", -1.0)
        monkeypatch.setattr(camera_tasks, "describe", opened)
        here = http.get("/cameras").json()[1]
        assert (here["state"], here["holder"], here["waiting"]) == ("capturing", first, 1)
        assert (here["model"], here["battery_percent"]) == ("NIKON D5100", 87)
        with context.engine.begin() as connection:
            jobs.ask_operator(connection, held, "Switch the flash off.", 60)
        assert http.get("/cameras").json()[1]["state"] == "waiting_for_operator"
        assert second != first

    def test_who_holds_it_is_told_to_those_who_may_know(
        self, http: httpx.Client, context: Context
    ) -> None:
        mine, other = bearing(context, "capture"), bearing(context, "capture")
        http.get("/cameras", headers=mine).raise_for_status()
        made = http.post(f"{PATH}/captures", json={}, headers=mine).json()["jobs"][0]
        assert made["owner"] == owner_of(mine)
        _hold(context, made["id"])
        shown = [http.get("/cameras", headers=key).json()[1] for key in (mine, other)]
        assert [(one["state"], one["holder"]) for one in shown] == [
            ("capturing", made["id"]),
            ("capturing", None),
        ]
        wanted = {"when_busy": "refuse"}
        answers = [http.post(f"{PATH}/captures", json=wanted, headers=key) for key in (mine, other)]
        assert problem_of(answers[0])[2].startswith(f"The job {made['id']} has the camera")
        assert problem_of(answers[1])[2].startswith("A job of another key has the camera")

    @pytest.mark.parametrize(
        ("method", "path"),
        [
            ("GET", "/cameras"),
            ("GET", "/cameras/events"),
            ("GET", f"{PATH}/settings"),
            ("PATCH", f"{PATH}/settings"),
            ("POST", f"{PATH}/captures"),
            ("POST", "/jobs/1/confirm"),
        ],
    )
    def test_cameras_are_for_keys_with_that_scope(
        self, http: httpx.Client, context: Context, method: str, path: str
    ) -> None:
        key = bearing(context, "read", "submit")
        refused = http.request(method, path, headers=key, json={})
        assert problem_of(refused)[:2] == (403, "forbidden")

    def test_changes_are_sent_as_they_happen(
        self, http: httpx.Client, capture: Any, context: Context
    ) -> None:
        with http.stream("GET", "/cameras/events") as answer:
            stream = events(answer)
            assert next(stream).data == http.get("/cameras").json()
            made = capture().json()["jobs"][0]
            assert next(stream).data[1]["waiting"] == 1
            _hold(context, made["id"])
            changed = next(stream).data[1]
        assert (changed["state"], changed["holder"]) == ("capturing", made["id"])


class TestSettings:
    def test_settings_are_read_with_their_choices(self, http: httpx.Client) -> None:
        settings = http.get(f"{PATH}/settings").raise_for_status().json()
        assert settings["iso"] == {
            "value": 100,
            "choices": [100, 200, 400, 800, 1600, 3200, 6400],
            "writable": True,
        }
        assert set(settings) == set(drivers.SettingName)

    def test_a_setting_that_is_written_is_read_back(self, http: httpx.Client) -> None:
        answer = http.patch(f"{PATH}/settings", json={"iso": 800, "white_balance": "tungsten"})
        assert answer.status_code == 200
        found = answer.json()
        assert (found["iso"]["value"], found["white_balance"]["value"]) == (800, "tungsten")

    @pytest.mark.parametrize(
        ("wanted", "detail"),
        [
            ({"iso": 123}, "The camera offers no iso of 123; it offers 100, 200, 400,"),
            ({"iso": "banana"}, "'banana' is not a value that iso can have."),
            ({"iso": -1}, "-1 is not a value that iso can have."),
            ({"iso": 10**30}, f"{10**30} is not a value that iso can have."),
            ({"shutter_s": 1e300}, "1e+300 is not a value that shutter_s can have."),
            ({"flash": "never"}, "'never' is not a value that flash can have."),
        ],
    )
    def test_a_wrong_value_is_told_in_the_drivers_words(
        self, http: httpx.Client, wanted: Any, detail: str
    ) -> None:
        status, kind, told = problem_of(http.patch(f"{PATH}/settings", json=wanted))
        assert (status, kind) == (422, "camera-setting")
        assert told.startswith(detail)

    @pytest.mark.parametrize(
        ("body", "words"),
        [
            ("", "body: Field required."),
            ("{", "Invalid JSON: Expecting property name enclosed in double quotes."),
            ("[]", "body: Input should be a valid object."),
            ("{}", "body: The object should have at least 1 item, not 0."),
            ('{"colour": 1}', "colour: this name is not known; it should be 'shutter_s', "),
            ('{"iso": null}', "iso: Input should be a valid integer, a valid number or a valid "),
            ('{"iso": true}', "iso: "),
            ('{"iso": [1]}', "iso: "),
            ('{"iso": NaN}', "iso: Input should be a valid integer, a finite number or a valid "),
            ('{"iso": ""}', "iso: "),
            ('{"iso": "' + 65 * "x" + '"}', "iso: "),
        ],
    )
    def test_what_says_no_settings_is_refused(
        self, http: httpx.Client, body: str, words: str
    ) -> None:
        headers = {"content-type": "application/json"}
        answer = http.patch(f"{PATH}/settings", content=body, headers=headers)
        status, kind, told = problem_of(answer)
        assert (status, kind) == (422, "invalid-request")
        assert told.startswith(words)
        assert "[" not in told

    def test_a_body_that_is_no_text_is_refused(self, http: httpx.Client) -> None:
        headers = {"content-type": "application/json"}
        answer = http.patch(f"{PATH}/settings", content=b"\x02\xff\xfe", headers=headers)
        assert problem_of(answer)[:2] == (400, "malformed-request")

    def test_a_camera_that_is_away_is_a_problem(self, http: httpx.Client) -> None:
        answer = http.get(f"/cameras/{cameras.id_of(AWAY)}/settings")
        status, kind, told = problem_of(answer)
        assert (status, kind) == (404, "camera-not-found")
        assert told.startswith("No camera answers at 127.0.0.1:1")

    def test_settings_of_a_camera_that_a_job_has_are_not_touched(
        self, http: httpx.Client, capture: Any, context: Context
    ) -> None:
        made = capture().json()["jobs"][0]["id"]
        _hold(context, made)
        for answer in (
            http.get(f"{PATH}/settings"),
            http.patch(f"{PATH}/settings", json={"iso": 200}),
        ):
            assert problem_of(answer) == (
                409,
                "camera-held",
                f"The job {made} has the camera; try again when it has ended.",
            )

    @pytest.mark.parametrize("camera", ["nothing", "0" * 16, "%00", "é"])
    def test_there_are_no_other_cameras(self, http: httpx.Client, camera: str) -> None:
        for answer in (
            http.get(f"/cameras/{camera}/settings"),
            http.patch(f"/cameras/{camera}/settings", json={"iso": 200}),
            http.post(f"/cameras/{camera}/captures", json={}),
        ):
            assert problem_of(answer)[:2] == (404, "unknown-camera")

    def test_a_camera_that_the_operator_allows_no_more_is_refused(
        self, http: httpx.Client, context: Context
    ) -> None:
        with context.engine.begin() as connection:
            camera = cameras.add(connection, FOREIGN)
        for answer in (
            http.get(f"/cameras/{camera}/settings"),
            http.post(f"/cameras/{camera}/captures", json={}),
        ):
            assert problem_of(answer)[:2] == (403, "foreign-camera")


class TestCaptures:
    def test_a_capture_is_a_job_in_the_cameras_queue(self, capture: Any, context: Context) -> None:
        wanted = {"flash": "operator", "settings": {"iso": 200}, "keep": False, "priority": "high"}
        answer = capture(**wanted, options={"lights": 2})
        assert answer.status_code == 202
        (job,) = answer.json()["jobs"]
        assert answer.headers["location"] == f"/jobs/{job['id']}"
        assert job["capture"] == {
            "camera": SIM,
            "flash": "operator",
            "when_busy": "wait",
            "settings": {"iso": 200},
            "keep": False,
        }
        assert (job["state"], job["position"], job["options"]) == ("queued", 1, {"lights": 2})
        assert (job["camera_settings"], job["operator"], job["inputs"]) == (None, None, None)
        (row,) = rows_of(context)
        assert (row.camera, row.priority) == (cameras.id_of(SIM), "high")

    def test_the_same_may_be_asked_for_by_address(self, http: httpx.Client) -> None:
        wanted = {"camera": f"{SIM}", "flash": "operator", "settings": {"iso": 200}}
        job = http.post("/jobs", json={"capture": wanted}).raise_for_status().json()
        assert job["capture"] == {**wanted, "when_busy": "wait", "keep": True}
        refused = http.post("/jobs", json={"capture": {**wanted, "when_busy": "refuse"}})
        assert problem_of(refused) == (
            409,
            "camera-held",
            "1 captures wait for the camera; try again later.",
        )

    def test_an_empty_body_asks_for_a_pair_as_the_camera_is_set(
        self, http: httpx.Client, capture: Any
    ) -> None:
        assert capture is not None
        answer = http.post(f"{PATH}/captures")
        assert answer.status_code == 202
        assert answer.json()["jobs"][0]["capture"]["settings"] == {}

    def test_a_camera_that_is_free_refuses_nobody(self, capture: Any, context: Context) -> None:
        first = capture(when_busy="refuse")
        assert first.status_code == 202
        assert problem_of(capture(when_busy="refuse"))[:2] == (409, "camera-held")
        _take(context, first.json()["jobs"][0]["id"], {})
        assert capture(when_busy="refuse").status_code == 202

    def test_a_burst_is_a_job_for_each_pair(self, capture: Any, context: Context) -> None:
        made = capture(pairs=3, interval_seconds=60, deadline_seconds=30).json()["jobs"]
        assert len({job["id"] for job in made}) == 3
        rows = {row.id: row for row in rows_of(context)}
        deadlines = [rows[job["id"]].deadline or 0 for job in made]
        assert [round(later - deadlines[0]) for later in deadlines] == [0, 60, 120]
        ranks = [rows[job["id"]].rank for job in made]
        assert ranks == sorted(set(ranks))

    def test_a_burst_that_is_sent_again_is_the_same(
        self, http: httpx.Client, capture: Any, context: Context
    ) -> None:
        assert capture is not None
        key = {"idempotency-key": "burst-1"}
        body = {"pairs": 3}
        first, again = (http.post(f"{PATH}/captures", json=body, headers=key) for _ in range(2))
        assert first.json() == again.json()
        assert again.headers["idempotency-replayed"] == "true"
        assert len(rows_of(context)) == 3
        other = http.post(f"{PATH}/captures", json={"pairs": 2}, headers=key)
        assert problem_of(other)[:2] == (422, "idempotency-key-reused")

    def test_a_burst_for_which_there_is_no_room_is_refused_whole(
        self, capture: Any, context: Context
    ) -> None:
        assert problem_of(capture(pairs=11))[:2] == (429, "queue-full")
        assert rows_of(context) == []
        assert capture(pairs=10).status_code == 202

    def test_the_next_shot_may_be_like_an_earlier_one(self, capture: Any, context: Context) -> None:
        options = {"lights": 2}
        first = capture(flash="operator", keep=False, options=options).json()["jobs"][0]
        _take(context, first["id"], {"iso": 400, "program": "manual", "f_number": 8.0})
        same = capture(like=first["id"]).json()["jobs"][0]
        assert same["options"] == options
        assert (same["capture"]["flash"], same["capture"]["keep"]) == ("operator", False)
        assert same["capture"]["settings"] == {"iso": 400, "program": "manual", "f_number": 8.0}
        other = capture(
            like=first["id"], flash="property", settings={"iso": 200}, options={"lights": 1}
        ).json()["jobs"][0]
        assert (other["capture"]["flash"], other["options"]) == ("property", {"lights": 1})
        assert other["capture"]["settings"]["iso"] == 200
        assert other["capture"]["settings"]["f_number"] == 8.0

    def test_a_job_without_a_pair_is_no_recipe(self, http: httpx.Client, capture: Any) -> None:
        first = capture().json()["jobs"][0]
        assert problem_of(capture(like=first["id"])) == (
            409,
            "not-ready",
            "like: the pair of this job is not taken yet.",
        )
        http.post(first["links"]["cancel"])
        assert problem_of(capture(like=first["id"]))[:2] == (409, "ended")
        assert problem_of(capture(like="nothing"))[:2] == (404, "unknown-job")

    def test_a_recipe_of_another_key_is_nobodys(self, http: httpx.Client, context: Context) -> None:
        mine, other = bearing(context, "capture"), bearing(context, "capture")
        http.get("/cameras", headers=mine)
        made = http.post(f"{PATH}/captures", json={}, headers=mine).json()["jobs"][0]
        _take(context, made["id"], {"iso": 400})
        answer = http.post(f"{PATH}/captures", json={"like": made["id"]}, headers=other)
        assert problem_of(answer)[:2] == (404, "unknown-job")

    def test_a_switch_that_is_not_there_is_told_before_the_first_shot(self, capture: Any) -> None:
        status, kind, told = problem_of(capture(flash="external"))
        assert (status, kind) == (422, "invalid-option")
        assert "LIGHTLAYERS_FLASH_SWITCH" in told

    @pytest.mark.parametrize(
        ("written", "detail"),
        [
            ({"flash": "off"}, "The flash is switched by the capture"),
            ({"program": "auto"}, "A pair is taken with program manual"),
            ({"iso": "auto"}, "A pair is taken with a fixed iso"),
        ],
    )
    def test_settings_that_no_pair_can_have_are_refused(
        self, capture: Any, written: Any, detail: str
    ) -> None:
        status, kind, told = problem_of(capture(settings=written))
        assert (status, kind) == (422, "camera-setting")
        assert told.startswith(detail)

    @pytest.mark.parametrize(
        ("wanted", "place"),
        [
            ({"flash": "radio"}, "flash"),
            ({"flash": "rm -rf {state}"}, "flash"),
            ({"when_busy": "steal"}, "when_busy"),
            ({"settings": {"colour": 1}}, "settings.colour"),
            ({"settings": {"iso": None}}, "settings.iso"),
            ({"pairs": 0}, "pairs"),
            ({"pairs": 1001}, "pairs"),
            ({"pairs": 1.5}, "pairs"),
            ({"interval_seconds": -1}, "interval_seconds"),
            ({"keep": "perhaps"}, "keep"),
            ({"options": {"lights": 9}}, "options.lights"),
            ({"camera": SIM}, "camera"),
            ({"switch": "http://elsewhere/{state}"}, "switch"),
        ],
    )
    def test_bad_wishes_are_refused(self, capture: Any, wanted: Any, place: str) -> None:
        status, kind, told = problem_of(capture(**wanted))
        assert (status, kind) == (422, "invalid-option")
        assert told.startswith(place)

    def test_other_bodies_are_refused(self, http: httpx.Client, capture: Any) -> None:
        assert capture is not None
        plain = http.post(
            f"{PATH}/captures", content=b"now", headers={"content-type": "text/plain"}
        )
        assert problem_of(plain)[0] == 415


class TestConfirm:
    def test_what_a_job_asks_for_is_shown_until_it_is_confirmed(
        self, http: httpx.Client, capture: Any, context: Context
    ) -> None:
        job = capture(flash="operator").json()["jobs"][0]
        held = _hold(context, job["id"])
        with context.engine.begin() as connection:
            jobs.ask_operator(connection, held, "Switch the flash off, then confirm.", 60)
        shown = http.get(f"/jobs/{job['id']}").json()
        assert shown["state"] == "waiting_for_operator"
        assert shown["operator"]["request"] == "Switch the flash off, then confirm."
        link = shown["links"]["confirm"]
        assert link == f"/jobs/{job['id']}/confirm?request=1"
        confirmed = http.post(link)
        assert (confirmed.status_code, confirmed.json()["state"]) == (202, "running")
        assert confirmed.json()["operator"] is None
        assert confirmed.json()["links"]["confirm"] is None
        status, kind, told = problem_of(http.post(link))
        assert (status, kind, told) == (
            409,
            "not-ready",
            "The job is running; it asks for nothing.",
        )

    def test_a_second_click_does_not_answer_the_next_request(
        self, http: httpx.Client, capture: Any, context: Context
    ) -> None:
        job = capture(flash="operator").json()["jobs"][0]
        held = _hold(context, job["id"])
        for request in ("off", "on"):
            with context.engine.begin() as connection:
                jobs.confirm(connection, job["id"])
                jobs.ask_operator(connection, held, f"Switch the flash {request}.", 60)
        here = f"/jobs/{job['id']}/confirm"
        assert problem_of(http.post(f"{here}?request=1"))[:2] == (409, "not-ready")
        assert http.post(here).json()["state"] == "running"

    def test_a_job_that_waits_may_be_canceled(
        self, http: httpx.Client, capture: Any, context: Context
    ) -> None:
        job = capture(flash="operator").json()["jobs"][0]
        held = _hold(context, job["id"])
        with context.engine.begin() as connection:
            jobs.ask_operator(connection, held, "Switch the flash off.", 60)
        canceling = http.post(f"/jobs/{job['id']}/cancel").json()
        assert (canceling["state"], canceling["operator"]) == ("canceling", None)
        assert problem_of(http.post(f"/jobs/{job['id']}/confirm"))[:2] == (409, "not-ready")

    def test_a_job_that_has_ended_asks_for_nothing_any_more(
        self, http: httpx.Client, capture: Any
    ) -> None:
        job = capture(flash="operator").json()["jobs"][0]
        http.post(f"/jobs/{job['id']}/cancel")
        answer = http.post(f"/jobs/{job['id']}/confirm")
        assert problem_of(answer) == (
            409,
            "ended",
            "The job is canceled; it asks for nothing any more.",
        )
        assert answer.json()["retryable"] is False

    @pytest.mark.parametrize("number", ["0", "-1", "x", "1e9"])
    def test_what_is_no_number_of_a_request_is_refused(
        self, http: httpx.Client, number: str
    ) -> None:
        assert problem_of(http.post(f"/jobs/1/confirm?request={number}"))[0] == 422

    def test_jobs_that_are_not_there_ask_for_nothing(self, http: httpx.Client) -> None:
        assert problem_of(http.post("/jobs/1/confirm"))[:2] == (404, "unknown-job")

    def test_nobody_confirms_for_another_key(self, http: httpx.Client, context: Context) -> None:
        mine, other = bearing(context, "capture"), bearing(context, "capture")
        http.get("/cameras", headers=mine)
        made = http.post(f"{PATH}/captures", json={}, headers=mine).json()["jobs"][0]
        answer = http.post(f"/jobs/{made['id']}/confirm", headers=other)
        assert problem_of(answer)[:2] == (404, "unknown-job")

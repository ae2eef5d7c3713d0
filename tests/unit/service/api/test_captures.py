"""The routes of captures; the queue of the camera is real, and nothing is taken."""

from __future__ import annotations

import re
from dataclasses import asdict
from typing import Any, NoReturn

import httpx
import pytest
import sqlalchemy as sa
from obstore.exceptions import GenericError

import drivers
from pipeline.options import MOST_ROWS
from service.api.camera_discovery import CameraDiscovery
from service.api.context import Context
from service.api.idempotency import digest
from service.dbos_queue import entries
from service.rows import bursts, cameras, heartbeats
from service.settings import Settings
from tests.unit.service.asking import bearing, problem_of, rows_of, stored_job
from tests.unit.service.studio import PATH, SIM, take, with_cameras

CALIBRATION = {"kind": "flash", "card": {"x": 20, "y": 20, "radius": 5}}

pytestmark = pytest.mark.usefixtures("cameras_in_process")


@pytest.fixture
def settings(settings: Settings) -> Settings:
    return with_cameras(settings)


class TestOnUsb:
    @pytest.fixture
    def settings(self, settings: Settings) -> Settings:
        return settings.model_copy(update={"cameras": "ptp+usb://"})

    def test_a_camera_on_usb_is_left_to_the_workers_of_the_host_that_saw_it(
        self, http: httpx.Client, context: Context, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        address = "ptp+usb://1"
        info = drivers.CameraInfo(address, "Make", "Model", "1", 80, 10**9)
        told = {"cameras": [address], "camera": {"info": asdict(info), "releases": True}}
        monkeypatch.setattr(CameraDiscovery, "_run", lambda _self, kind, _order: told[kind])
        context.camera_discovery._host = "studio"
        with context.engine.begin() as connection:
            heartbeats.beat(connection, "studio-1-0a1b2c3d")
        assert [one["address"] for one in http.get("/cameras").json()] == [address]
        made = http.post("/jobs", json={"capture": {"camera": address}}).raise_for_status().json()
        with context.engine.connect() as connection:
            query = sa.text("SELECT queue_name FROM workflow_status WHERE workflow_uuid = :id")
            queue = connection.execute(query, {"id": entries.capture_id(made["id"])}).scalar()
        assert queue == entries.captures_on("studio") == "captures@studio"


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
            "1 capture waits for the camera; try again later.",
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
        take(context, first.json()["jobs"][0]["id"], {})
        assert capture(when_busy="refuse").status_code == 202

    def test_a_key_that_is_sent_twice_at_once_finds_its_own_job_and_no_camera_that_is_held(
        self, http: httpx.Client, capture: Any, context: Context, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        assert capture is not None
        first: list[httpx.Response] = []
        new_ids = bursts.new_ids

        def send() -> httpx.Response:
            key = {"idempotency-key": "once"}
            return http.post(f"{PATH}/captures", json={"when_busy": "refuse"}, headers=key)

        def after_the_first(count: int) -> list[str]:
            monkeypatch.setattr(bursts, "new_ids", new_ids)
            first.append(send())
            return new_ids(count)

        monkeypatch.setattr(bursts, "new_ids", after_the_first)
        later = send()
        assert (first[0].status_code, later.status_code) == (202, 202)
        assert later.json() == first[0].json()
        assert later.headers["idempotency-replayed"] == "true"
        assert len(rows_of(context)) == 1

    def test_a_burst_is_a_job_for_each_pair(self, capture: Any, context: Context) -> None:
        made = capture(pairs=3, interval_seconds=60, deadline_seconds=30).json()["jobs"]
        assert len({job["id"] for job in made}) == 3
        rows = {row.id: row for row in rows_of(context)}
        deadlines = [rows[job["id"]].deadline or 0 for job in made]
        assert [round(later - deadlines[0]) for later in deadlines] == [0, 60, 120]
        ranks = [rows[job["id"]].rank for job in made]
        assert ranks == sorted(set(ranks))

    @pytest.mark.parametrize(
        ("path", "body"),
        [
            ("/jobs", {"capture": {"camera": SIM}}),
            ("/calibrations", {"capture": {"camera": SIM}, "options": CALIBRATION}),
            (f"{PATH}/captures", {}),
        ],
    )
    def test_captures_need_no_store_that_others_wait_for(
        self,
        path: str,
        body: Any,
        http: httpx.Client,
        capture: Any,
        monkeypatch: pytest.MonkeyPatch,
    ) -> None:
        async def hang(*_arguments: object) -> NoReturn:
            raise GenericError("the store is away")

        assert capture is not None
        for threads in ("store", "fetch"):
            monkeypatch.setattr(Context, threads, hang)
        assert http.post(path, json=body).status_code == 202

    def test_a_burst_that_is_sent_again_is_the_same(
        self, http: httpx.Client, capture: Any, context: Context
    ) -> None:
        assert capture is not None
        key = {"idempotency-key": "burst-1"}
        body = {"pairs": 3.0}  # a whole number, as JSON has it
        first, again = (http.post(f"{PATH}/captures", json=body, headers=key) for _ in range(2))
        assert first.json() == again.json()
        assert again.headers["idempotency-replayed"] == "true"
        assert len(rows_of(context)) == 3
        other = http.post(f"{PATH}/captures", json={"pairs": 2}, headers=key)
        assert problem_of(other)[:2] == (422, "idempotency-key-reused")

    def test_a_burst_is_known_by_what_was_asked_of_it_alone(
        self, http: httpx.Client, capture: Any, context: Context
    ) -> None:
        assert capture is not None
        body = {"pairs": 2, "flash": "property", "options": {"lights": 2, "exposure_ratio": None}}
        assert http.post(f"{PATH}/captures", json=body).status_code == 202
        asked = {"camera": SIM, "wanted": body}
        assert {row.request_hash for row in rows_of(context)} == {digest(asked)}

    def test_a_burst_is_not_taken_anew_while_a_job_of_it_is_kept(
        self, http: httpx.Client, capture: Any, context: Context
    ) -> None:
        assert capture is not None

        def send() -> httpx.Response:
            key = {"idempotency-key": "burst-1"}
            return http.post(f"{PATH}/captures", json={"pairs": 3}, headers=key)

        ids = [job["id"] for job in send().json()["jobs"]]
        for deleted, kept in ((0, ids[1:]), (2, ids[1:2])):
            assert http.delete(f"/jobs/{ids[deleted]}").status_code == 204
            again = send()
            assert [job["id"] for job in again.json()["jobs"]] == kept
            assert again.headers["idempotency-replayed"] == "true"
            assert again.headers["location"] == f"/jobs/{kept[0]}"
        assert [row.id for row in rows_of(context)] == ids[1:2]
        assert http.delete(f"/jobs/{ids[1]}").status_code == 204
        anew = send()
        assert len(anew.json()["jobs"]) == 3
        assert "idempotency-replayed" not in anew.headers

    def test_a_burst_for_which_there_is_no_room_is_refused_whole(
        self, capture: Any, context: Context
    ) -> None:
        assert problem_of(capture(pairs=11)) == (
            429,
            "queue-full",
            "0 jobs of yours wait already, and 10 may; ask for fewer than these 11, or later.",
        )
        assert rows_of(context) == []
        assert capture(pairs=10).status_code == 202

    def test_a_burst_whose_options_would_fill_the_database_is_refused_whole(
        self, capture: Any, context: Context
    ) -> None:
        wavelengths = [300.000123456789 + 0.4 * row for row in range(MOST_ROWS)]
        tables = [
            {"wavelength_nm": wavelengths, "power": [0.12345678901234568, *[1 / (7 + one)] * 1999]}
            for one in range(10)
        ]
        options = {"flash_spectrum": tables[0], "neutral": tables[0], "forbidden_lamps": tables}
        status, kind, told = problem_of(capture(pairs=10, options=options))
        assert (status, kind) == (422, "invalid-option")
        assert re.fullmatch(
            r"options: for 10 pairs they take [0-9,]+ bytes of 8,388,608: name a calibration in "
            "place of tables, or ask for fewer pairs.",
            told,
        )
        assert rows_of(context) == []
        assert capture(pairs=1, options=options).status_code == 202

    def test_the_next_shot_may_be_like_an_earlier_one(self, capture: Any, context: Context) -> None:
        options = {"lights": 2}
        first = capture(flash="operator", keep=False, options=options).json()["jobs"][0]
        take(context, first["id"], {"iso": 400, "program": "manual", "f_number": 8.0})
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

    @pytest.mark.parametrize("said", ["", "f/" + 70 * "8"])
    def test_what_no_request_can_ask_for_is_told_and_refused_in_words(
        self, http: httpx.Client, capture: Any, context: Context, said: str
    ) -> None:
        first = capture().json()["jobs"][0]
        take(context, first["id"], {"iso": 400, "f_number": said})
        told = http.get("/jobs").raise_for_status().json()["jobs"][0]
        assert told["camera_settings"] == {"iso": 400, "f_number": said}
        status, kind, detail = problem_of(capture(like=first["id"]))
        assert (status, kind) == (422, "invalid-option")
        assert detail.startswith("settings.f_number: ")
        assert capture(like=first["id"], settings={"f_number": 8.0}).status_code == 202

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

    def test_a_job_of_uploads_is_never_a_recipe(self, capture: Any, context: Context) -> None:
        answer = capture(like=stored_job(context))
        assert problem_of(answer) == (
            422,
            "invalid-option",
            "like: the job separates no pair that a camera takes; name one that does.",
        )
        assert answer.json()["retryable"] is False

    def test_a_recipe_of_another_key_is_nobodys(self, http: httpx.Client, context: Context) -> None:
        mine, other = bearing(context, "capture"), bearing(context, "capture")
        http.get("/cameras", headers=mine)
        made = http.post(f"{PATH}/captures", json={}, headers=mine).json()["jobs"][0]
        take(context, made["id"], {"iso": 400})
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

"""The routes of cameras; what they ask of a camera is done in this process."""

from __future__ import annotations

import contextlib
import errno
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import httpx
import pytest

import drivers
from service.api.camera_discovery import WATCH_SECONDS, CameraDiscovery
from service.api.context import Context
from service.errors import NoProcessError, StorageFullError
from service.rows import attempts, cameras
from service.settings import Settings
from service.workers import camera_tasks
from service.workers.tasks import FindCameras
from tests.unit.service.asking import bearing, owner_of, problem_of
from tests.unit.service.at_first import raising
from tests.unit.service.streams import events
from tests.unit.service.studio import AWAY, PATH, SIM, hold, take_release_away, with_cameras

FOREIGN = "ptp+ip://192.168.1.99"


pytestmark = pytest.mark.usefixtures("cameras_in_process")


@pytest.fixture
def settings(settings: Settings) -> Settings:
    return with_cameras(settings)


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

    def test_a_camera_that_no_order_releases_is_told_from_those_that_are_ready(
        self, http: httpx.Client, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr("service.api.camera_discovery._FRESH_SECONDS", -1.0)
        with monkeypatch.context() as other:
            take_release_away(other)
            assert [one["state"] for one in http.get("/cameras").json()] == ["away", "unable"]
        assert [one["state"] for one in http.get("/cameras").json()] == ["away", "idle"]

    @pytest.mark.parametrize("allowed", [AWAY, "ptp+ip://"])
    def test_announcements_are_listened_to_where_all_cameras_of_the_network_are_allowed(
        self, context: Context, allowed: str, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        asked: list[Any] = []

        def run(_looking: CameraDiscovery, kind: str, wanted: Any) -> list[str]:
            asked.append((kind, wanted))
            if kind == "cameras":
                return []
            raise drivers.CameraNotFoundError("away")

        monkeypatch.setattr(CameraDiscovery, "_run", run)
        settings = context.settings.model_copy(update={"cameras": allowed})
        with contextlib.closing(
            CameraDiscovery(context.engine, settings, context.fork_server)
        ) as looking:
            looking.refresh().result(60)
        assert asked[0] == ("cameras", FindCameras(network=allowed == "ptp+ip://"))

    @pytest.mark.parametrize(
        "error",
        [OSError(errno.ENOSPC, "full"), StorageFullError("The disk is full."), NoProcessError()],
    )
    def test_a_machine_that_has_nothing_left_leaves_looks_unanswered(
        self, error: Exception, http: httpx.Client, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(CameraDiscovery, "_run", raising(error))
        shown = http.get("/cameras").raise_for_status().json()
        assert {one["address"]: one["state"] for one in shown} == {SIM: "away", AWAY: "away"}

    def test_a_camera_that_another_process_saw_just_now_is_left_alone(
        self, http: httpx.Client, context: Context, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        http.get("/cameras").raise_for_status()
        looked: list[str] = []

        def run(_looking: CameraDiscovery, kind: str, _wanted: Any) -> list[str]:
            looked.append(kind)
            return []

        monkeypatch.setattr(CameraDiscovery, "_run", run)
        with contextlib.closing(
            CameraDiscovery(context.engine, context.settings, context.fork_server)
        ) as other:
            other.refresh().result(60)
        assert looked == ["cameras"]
        assert http.get("/cameras").json()[1]["state"] == "idle"

    def test_a_camera_that_a_job_has_is_told_as_it_was(
        self, http: httpx.Client, capture: Any, context: Context, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        first, second = (capture().json()["jobs"][0]["id"] for _ in range(2))
        held = hold(context, first)

        def opened(*_arguments: object) -> None:
            pytest.fail("a camera was opened that a job has")

        monkeypatch.setattr("service.api.camera_discovery._FRESH_SECONDS", -1.0)
        monkeypatch.setattr(camera_tasks, "describe", opened)
        here = http.get("/cameras").json()[1]
        assert (here["state"], here["holder"], here["waiting"]) == ("capturing", first, 1)
        assert (here["model"], here["battery_percent"]) == ("NIKON D5100", 87)
        with context.engine.begin() as connection:
            attempts.ask_operator(connection, held, "Switch the flash off.", 60)
        assert http.get("/cameras").json()[1]["state"] == "waiting_for_operator"
        assert second != first

    def test_who_holds_it_is_told_to_those_who_may_know(
        self, http: httpx.Client, context: Context
    ) -> None:
        mine, other = bearing(context, "capture"), bearing(context, "capture")
        http.get("/cameras", headers=mine).raise_for_status()
        made = http.post(f"{PATH}/captures", json={}, headers=mine).json()["jobs"][0]
        assert made["owner"] == owner_of(mine)
        hold(context, made["id"])
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

    def test_a_camera_that_is_slow_takes_no_thread_of_other_requests(
        self, http: httpx.Client, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """More clients wait for the look than there are threads."""
        looked = threading.Event()
        monkeypatch.setattr(CameraDiscovery, "_look_everywhere", lambda _looking: looked.wait(60))
        with ThreadPoolExecutor(60) as pool:
            waiting = [pool.submit(http.get, "/cameras") for _ in range(60)]
            assert http.get("/jobs").status_code == 200
            assert not any(one.done() for one in waiting)
            looked.set()
            assert {one.result().status_code for one in waiting} == {200}

    def test_changes_are_sent_as_they_happen(
        self, http: httpx.Client, capture: Any, context: Context
    ) -> None:
        with http.stream("GET", "/cameras/events") as answer:
            stream = events(answer)
            assert next(stream).data == http.get("/cameras").json()
            made = capture().json()["jobs"][0]
            assert next(stream).data[1]["waiting"] == 1
            hold(context, made["id"])
            changed = next(stream).data[1]
        assert (changed["state"], changed["holder"]) == ("capturing", made["id"])

    def test_one_look_at_the_rows_serves_all_who_watch(
        self, http: httpx.Client, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        http.get("/cameras").raise_for_status()
        looks = []
        find_all = cameras.find_all

        def count(*of: Any) -> Any:
            looks.append(time.monotonic())
            return find_all(*of)

        monkeypatch.setattr(cameras, "find_all", count)

        def watch(_number: int) -> None:
            with http.stream("GET", "/cameras/events") as answer:
                stream = events(answer)  # which ends the request once it is let go
                assert len(next(stream).data) == 2
                time.sleep(2)

        with ThreadPoolExecutor(8) as pool:
            began = time.monotonic()
            list(pool.map(watch, range(8)))
        assert 1 < len(looks) <= (time.monotonic() - began) / WATCH_SECONDS + 1
        assert all(later - one > 0.9 * WATCH_SECONDS for one, later in pairwise(looks))


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
            ({"iso": "banana"}, "The camera offers no iso of banana; it offers 100,"),
            ({"iso": -1}, "The camera offers no iso of -1; it offers 100,"),
            ({"iso": 10**30}, f"The camera offers no iso of {10**30}; it offers 100,"),
            ({"shutter_s": 1e300}, "The camera offers no shutter_s of 1e+300; it offers 0.005,"),
            ({"flash": "never"}, "The camera offers no flash of never; it offers off,"),
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
            ("", "Invalid JSON: EOF while parsing a value at line 1 column 0."),
            ("{", "Invalid JSON: EOF while parsing an object at line 1 column 1."),
            ("\x02", "Invalid JSON: expected value at line 1 column 1."),
            ("[]", "Input should be an object."),
            ("{}", "The object should have at least 1 item, not 0."),
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
        assert (status, kind) == (422, "invalid-option")
        assert told.startswith(words)
        assert "[" not in told

    @pytest.mark.parametrize(
        ("body", "media_type", "status", "kind"),
        [
            (b"\x02\xff\xfe", "application/json", 422, "invalid-option"),
            (b'{"iso": 200}', "text/plain", 415, "unsupported-media-type"),
            (b'{"iso": 200}' + b" " * 2**20, "application/json", 413, "upload-too-large"),
        ],
    )
    def test_a_body_that_is_no_json_of_usual_size_is_refused(
        self, http: httpx.Client, body: bytes, media_type: str, status: int, kind: str
    ) -> None:
        headers = {"content-type": media_type}
        answer = http.patch(f"{PATH}/settings", content=body, headers=headers)
        assert problem_of(answer)[:2] == (status, kind)

    def test_a_camera_that_is_slow_takes_no_thread_of_other_requests(
        self, http: httpx.Client, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """More clients wait for its settings than there are threads."""
        http.get("/cameras").raise_for_status()
        answered = threading.Event()
        monkeypatch.setattr(
            CameraDiscovery, "adjust", lambda *_arguments: answered.wait(120) and {}
        )
        with ThreadPoolExecutor(60) as pool:
            waiting = [pool.submit(http.get, f"{PATH}/settings") for _ in range(60)]
            for _ in range(20):  # the last ones come when all are there
                assert http.get("/jobs", timeout=60).status_code == 200
            assert not any(one.done() for one in waiting)
            answered.set()
            assert {one.result().status_code for one in waiting} == {200}

    def test_who_waited_long_for_a_thread_waits_no_longer_for_the_camera(
        self, http: httpx.Client, context: Context, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        http.get("/cameras").raise_for_status()
        places, answered = context.asking.total_tokens, threading.Event()
        tries: list[None] = []

        def adjust(*_arguments: object) -> dict[str, Any] | None:
            tries.append(None)
            return {} if len(tries) <= places and answered.wait(120) else None

        monkeypatch.setattr(CameraDiscovery, "adjust", adjust)
        monkeypatch.setattr("service.api.cameras._PATIENCE_SECONDS", 0.2)
        with ThreadPoolExecutor(60) as pool:
            for _ in range(int(places)):
                pool.submit(http.get, f"{PATH}/settings")
            while len(tries) < places:
                time.sleep(0.01)
            last = pool.submit(http.get, f"{PATH}/settings")
            while not context.asking.statistics().tasks_waiting:
                time.sleep(0.01)
            time.sleep(0.3)  # longer than its patience
            answered.set()
            assert problem_of(last.result())[:2] == (409, "camera-held")
        assert len(tries) == places + 1

    def test_settings_are_told_as_the_camera_says_them(
        self, http: httpx.Client, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        said = {"f_number": {"value": "", "choices": ["", 70 * "8", 8.0], "writable": False}}
        monkeypatch.setattr(CameraDiscovery, "adjust", lambda *_arguments: said)
        assert http.get(f"{PATH}/settings").raise_for_status().json() == said

    def test_a_camera_that_is_away_is_a_problem(self, http: httpx.Client) -> None:
        answer = http.get(f"/cameras/{cameras.id_of(AWAY)}/settings")
        status, kind, told = problem_of(answer)
        assert (status, kind) == (404, "camera-not-found")
        assert told.startswith("No camera answers at 127.0.0.1:1")

    def test_settings_of_a_camera_that_a_job_has_are_not_touched(
        self, http: httpx.Client, capture: Any, context: Context
    ) -> None:
        made = capture().json()["jobs"][0]["id"]
        hold(context, made)
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

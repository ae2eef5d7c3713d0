"""What a process does with a camera: with a simulated one on the network, as a studio's is."""

from __future__ import annotations

import json
import sys
import threading
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from typing import Any

import pytest

import drivers
from drivers import SettingName
from drivers.errors import UnconfirmedError
from drivers.ptp.codes import Property
from drivers.sim.body import Body
from service.workers import camera_tasks
from service.workers.tasks import (
    Adjust,
    CameraOrder,
    FindCameras,
    Kind,
    Limits,
    LookAt,
    TakePair,
    Task,
)

Answer = Callable[[dict[str, Any]], bool]


def _task(kind: Kind, order: CameraOrder, directory: Path = Path()) -> Task:
    return Task(kind, "a", "", str(directory), Limits(0, 0, 0, 0, 0), {}, order)


@pytest.fixture
def camera() -> Iterator[Any]:
    served = drivers.serve_simulated("sim://studio?width=64&height=64&noise=off", "127.0.0.1", 0)
    yield served
    served.close()


class _Process:
    """stdin and stdout of a task, and who is asked."""

    def __init__(self, answer: Answer) -> None:
        self.told: list[dict[str, Any]] = []
        self.questions: list[dict[str, Any]] = []
        self._answer = answer

    def tell(self, message: dict[str, Any]) -> None:
        self.told.append(message)
        if "question" in message:
            self.questions.append(message["question"])

    def readline(self) -> str:
        return json.dumps(self._answer(self.questions[-1])) + "\n"


@pytest.fixture
def capture(
    camera: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Callable[..., _Process]:
    def run(answer: Answer = lambda _question: True, **wanted: Any) -> _Process:
        process = _Process(answer)
        monkeypatch.setattr(sys, "stdin", process)
        order = TakePair(f"ptp+ip://{camera.address}", **wanted)
        camera_tasks.capture(_task("capture", order, tmp_path), process.tell)
        return process

    return run


def _on_card(camera: Any) -> int:
    with drivers.open_camera(f"ptp+ip://{camera.address}") as opened:
        kinds = [opened.describe(handle).kind for handle in opened.objects()]
    return len([kind for kind in kinds if kind != "folder"])


def test_a_pair_is_taken_with_the_settings_asked_for(
    capture: Callable[..., _Process], camera: Any, tmp_path: Path
) -> None:
    told = capture(settings={"iso": 400, "white_balance": "tungsten"}).told
    answer = told[-1]["answer"]
    assert answer["settings"]["iso"] == 400
    assert answer["settings"]["white_balance"] == "tungsten"
    assert answer["settings"]["program"] == "manual"
    assert (answer["info"]["battery_percent"], answer["info"]["model"]) == (87, "NIKON D5100")
    sizes = [(tmp_path / frame).stat().st_size for frame in ("no_flash", "flash")]
    assert answer["info"]["free_bytes"] == 2 * 10**9 - sum(sizes)
    assert _on_card(camera) == 2
    assert json.loads(json.dumps(told)) == told  # as it goes through a pipe


def test_a_time_is_taken_as_the_camera_rounds_it(capture: Callable[..., _Process]) -> None:
    """The names of settings are plain text here, as JSON has them."""
    settings = json.loads('{"shutter_s": 0.0401}')
    answer = capture(settings=settings).told[-1]["answer"]
    assert answer["settings"]["shutter_s"] == 0.04


def test_a_wrong_setting_is_told_before_the_first_photograph(
    capture: Callable[..., _Process], camera: Any
) -> None:
    with pytest.raises(drivers.SettingError, match="offers no iso of 123; it offers 100,"):
        capture(settings={"iso": 123})
    assert _on_card(camera) == 0


def test_the_card_is_cleared_once_the_pair_is_kept(
    capture: Callable[..., _Process], camera: Any, tmp_path: Path
) -> None:
    def keep(question: dict[str, Any]) -> bool:
        assert question["kind"] == "keep"
        assert question["settings"]["iso"] == 100
        return all((tmp_path / frame).stat().st_size > 0 for frame in ("no_flash", "flash"))

    process = capture(keep, keep=False)
    assert len(process.questions) == 1
    assert _on_card(camera) == 0


def test_jpegs_beside_the_raw_files_stay_on_the_card(
    capture: Callable[..., _Process], camera: Any, tmp_path: Path
) -> None:
    """They are stored nowhere else."""
    with drivers.open_camera(f"ptp+ip://{camera.address}") as opened:
        opened.write(SettingName.FORMAT, "raw+jpeg_fine")
    capture(keep=False)
    assert (tmp_path / "flash").read_bytes().startswith(b"II*")
    with drivers.open_camera(f"ptp+ip://{camera.address}") as opened:
        kinds = sorted(opened.describe(handle).kind for handle in opened.objects())
    assert kinds == ["folder", "jpeg", "jpeg"]


def test_a_pair_that_could_not_be_kept_stays_on_the_card(
    capture: Callable[..., _Process], camera: Any
) -> None:
    capture(lambda _question: False, keep=False)
    assert _on_card(camera) == 2


def test_a_camera_that_goes_when_its_pair_is_kept_costs_nothing(
    capture: Callable[..., _Process], camera: Any, caplog: pytest.LogCaptureFixture
) -> None:
    def unplug(_question: dict[str, Any]) -> bool:
        camera.close()
        return True

    answer = capture(unplug, keep=False).told[-1]["answer"]
    assert (answer["settings"]["iso"], answer["info"]) == (100, None)
    assert "the camera failed after its pair: CameraDisconnectedError" in caplog.text


def test_a_person_is_asked_for_the_flash(capture: Callable[..., _Process], camera: Any) -> None:
    def switch(question: dict[str, Any]) -> bool:
        on = "flash on" in question["request"]
        camera.order("flash external" if on else "flash off")
        return True

    process = capture(switch, flash="operator", operator_seconds=7.0)
    assert process.questions == [
        {
            "kind": "operator",
            "request": f"Switch the flash {state}, then confirm.",
            "seconds": 7.0,
        }
        for state in ("off", "on")
    ]


def test_a_person_who_does_nothing_ends_the_capture(
    capture: Callable[..., _Process], camera: Any
) -> None:
    with pytest.raises(UnconfirmedError, match="Nobody confirmed that the flash is off"):
        capture(lambda _question: False, flash="operator", operator_seconds=7.0)
    assert _on_card(camera) == 0


def test_a_switch_is_told_what_the_operator_has_set(
    capture: Callable[..., _Process], camera: Any
) -> None:
    told = []

    class Relay(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            told.append(self.path)
            camera.order("flash external" if self.path == "/on" else "flash off")
            self.send_response(204)
            self.end_headers()

        def log_message(self, format: str, *arguments: object) -> None:
            """Stay quiet."""

    with HTTPServer(("127.0.0.1", 0), Relay) as relay:
        thread = threading.Thread(target=relay.serve_forever)
        thread.start()
        switch = f"http://127.0.0.1:{relay.server_port}/{{state}}"
        capture(flash="external", switch=switch, settle_seconds=0)
        relay.shutdown()
        thread.join()
    assert told == ["/off", "/on", "/off"]


def test_settings_are_written_in_one_session_and_read_back(camera: Any) -> None:
    told: list[dict[str, Any]] = []
    settings = json.loads('{"iso": 800, "f_number": 11}')
    wanted = Adjust(f"ptp+ip://{camera.address}", settings)
    camera_tasks.adjust(_task("camera_settings", wanted), told.append)
    settings = told[0]["answer"]["settings"]
    assert (settings["iso"]["value"], settings["f_number"]["value"]) == (800, 11.0)
    assert settings["iso"]["writable"] and 6400 in settings["iso"]["choices"]


def test_the_program_is_written_before_the_time_that_it_locks(
    camera: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As Nikon's bodies have it."""
    writable = Body.writable

    def locked(body: Body, code: int) -> bool:
        manual = body.properties[Property.EXPOSURE_PROGRAM].current == 1
        return writable(body, code) and (manual or code != Property.EXPOSURE_TIME)

    monkeypatch.setattr(Body, "writable", locked)
    told: list[dict[str, Any]] = []
    address = f"ptp+ip://{camera.address}"
    wanted = Adjust(address, {SettingName.SHUTTER_S: 0.0401, SettingName.PROGRAM: "manual"})
    camera_tasks.adjust(_task("camera_settings", wanted), told.append)
    now = told[0]["answer"]["settings"]
    assert (now["program"]["value"], now["shutter_s"]["value"]) == ("manual", 0.04)


def test_a_camera_tells_of_itself(camera: Any) -> None:
    told: list[dict[str, Any]] = []
    address = f"ptp+ip://{camera.address}"
    camera_tasks.describe(_task("camera", LookAt(address)), told.append)
    assert told == [
        {
            "answer": {
                "info": {
                    "address": address,
                    "make": "NIKON CORPORATION",
                    "model": "NIKON D5100",
                    "serial": "0000001",
                    "battery_percent": 87,
                    "free_bytes": 2 * 10**9,
                },
                "releases": True,
            }
        }
    ]


@pytest.mark.parametrize("network", [True, False])
def test_cameras_that_are_found_are_named(network: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    announced = drivers.CameraInfo("ptp+ip://192.168.1.7", "", "Model", "", None)
    monkeypatch.setattr("drivers.ptp.ip.ANNOUNCED", heard := {})

    def listen() -> None:
        heard["name"] = announced

    monkeypatch.setattr(drivers, "listen_to_network", listen)
    told: list[dict[str, Any]] = []
    camera_tasks.find(_task("cameras", FindCameras(network)), told.append)
    assert "sim://studio" in told[0]["answer"]
    assert (announced.address in told[0]["answer"]) is network

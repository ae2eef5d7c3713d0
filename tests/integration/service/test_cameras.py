"""One camera, several workers: its pairs are taken one after the other, and none of two halves."""

from __future__ import annotations

import hashlib
import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest
import sqlalchemy as sa

import drivers
from service.rows import cameras, database, tables
from tests.integration.service.real_service import Service

FAST = {"quality": "fast", "lights": 2, "align": False, "outputs": ["layers.exr"]}


@pytest.fixture(scope="module")
def camera() -> Iterator[Any]:
    """A simulated camera on the network."""
    served = drivers.serve_simulated("sim://studio?width=96&height=64&noise=off", "127.0.0.1", 0)
    yield served
    served.close()


@pytest.fixture(scope="module", params=["sqlite", "postgresql"])
def service(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory, camera: Any
) -> Iterator[Service]:
    """A service that may use this camera, with a second worker."""
    settings = {"cameras": f"ptp+ip://{camera.address}"}
    if request.param == "postgresql":
        settings["database_url"] = request.getfixturevalue("make_database")()
    service = Service(tmp_path_factory.mktemp("service"), **settings)
    if request.param == "postgresql":
        service.migrate()
    service.start()
    service.start_worker()
    yield service
    service.close()


def _camera(service: Any) -> dict[str, Any]:
    (listed,) = service.http.get("/cameras").raise_for_status().json()
    found: dict[str, Any] = listed
    return found


def _capture(service: Any, **wanted: Any) -> list[dict[str, Any]]:
    path = f"/cameras/{_camera(service)['id']}/captures"
    answer = service.http.post(path, json={"options": FAST, **wanted})
    assert answer.status_code == 202, answer.text
    made: list[dict[str, Any]] = answer.json()["jobs"]
    return made


def _on_card(camera: Any) -> list[str]:
    """Digests of the photographs on the card, in the order they were taken; they are deleted."""
    with drivers.open_camera(f"ptp+ip://{camera.address}") as opened:
        described = [opened.describe(handle) for handle in sorted(opened.objects())]
        found = [one.handle for one in described if one.kind != "folder"]
        digests = [hashlib.sha256(b"".join(opened.download(one))).hexdigest() for one in found]
        for handle in found:
            opened.delete(handle)
        return digests


def _digests(job: dict[str, Any]) -> list[str]:
    return [job["inputs"][frame]["sha256"] for frame in ("no_flash", "flash")]


def _asking(service: Any, job: dict[str, Any], request: str) -> dict[str, Any]:
    found: list[dict[str, Any]] = []

    def asks() -> bool:
        now = service.look(job)
        assert now["state"] in ("queued", "running", "waiting_for_operator"), now
        if now["operator"] and request in now["operator"]["request"]:
            found.append(now)
        return bool(found)

    service.await_that(f"the job asks for: {request}", asks)
    return found[-1]


def _confirm(service: Any, asking: dict[str, Any]) -> None:
    service.http.post(asking["links"]["confirm"]).raise_for_status()


def test_pairs_of_a_camera_are_taken_in_order_by_whichever_worker(
    service: Any, camera: Any
) -> None:
    camera.order("flash mode")
    # Both workers may be about to look at it.
    service.await_that("it was looked at", lambda: _camera(service)["state"] == "idle")
    idle = _camera(service)
    assert (idle["state"], idle["model"], idle["battery_percent"]) == ("idle", "NIKON D5100", 87)
    made = _capture(service, pairs=3, settings={"iso": 400}, keep=True)
    done = [service.await_end(job) for job in made]
    assert [job["error"] for job in done] == [None] * 3
    assert [job["camera_settings"]["iso"] for job in done] == [400] * 3
    assert sorted(job["started"] for job in done) == [job["started"] for job in done]
    # A second session, or two captures at once, would have mixed them up on the card.
    taken = [digest for job in done for digest in _digests(job)]
    assert taken == _on_card(camera)
    after = _camera(service)
    assert (after["state"], after["holder"], after["waiting"]) == ("idle", None, 0)


def test_a_worker_that_dies_between_the_photographs_costs_a_whole_pair(
    service: Any, camera: Any
) -> None:
    camera.order("flash off")
    (job,) = _capture(service, flash="operator", keep=False)
    _confirm(service, _asking(service, job, "flash off"))
    between = _asking(service, job, "flash on")
    held = _camera(service)
    assert (held["state"], held["holder"]) == ("waiting_for_operator", job["id"])
    _kill_worker_of(service, job)
    again = _asking(service, job, "flash off")
    assert again["attempt"] == between["attempt"] + 1
    late = service.http.post(between["links"]["confirm"])
    assert late.status_code == 409
    _confirm(service, again)
    asking = _asking(service, job, "flash on")
    camera.order("flash external")
    _confirm(service, asking)
    done = service.await_end(job)
    assert (done["state"], done["error"]) == ("succeeded", None)
    # Those of the pair went once they were stored; that of the lost attempt is nobody's to delete.
    (first,) = _on_card(camera)
    assert first not in _digests(done)


def _kill_worker_of(service: Any, job: dict[str, Any]) -> None:
    """Kill the worker that has the job, as a power cut would."""
    command = [sys.executable, "-m", "service.cli", "jobs", "show", job["id"]]
    shown = subprocess.run(command, env=service.environment, capture_output=True, check=True)
    *_, pid, _ = json.loads(shown.stdout)["worker"].split("-")
    os.kill(int(pid), signal.SIGKILL)


def test_of_two_names_of_one_camera_on_usb_one_is_used_at_a_time(postgresql: str) -> None:
    """Where rows are locked one by one, and that of a camera is made as it is first named."""
    engine = database.connect(postgresql)
    tables.metadata.create_all(engine)
    both = threading.Barrier(2)

    def use(address: str) -> bool:
        with engine.begin() as connection:
            both.wait(60)
            camera = cameras.add(connection, address)
            return cameras.take(connection, camera, 60) is not None

    def free() -> None:
        with engine.begin() as connection:
            connection.execute(sa.delete(tables.cameras))

    with ThreadPoolExecutor(2) as pool:
        for serial in range(50):
            taken = list(pool.map(use, ["ptp+usb://", f"ptp+usb://{serial}"]))
            assert sorted(taken) == [False, True]
            free()
    engine.dispose()

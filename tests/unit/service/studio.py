"""A service with a simulated camera and one that is switched off."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

import drivers
from drivers.ptp.datasets import DeviceInfo
from drivers.sim.responder import RELEASES
from service.api.camera_discovery import CameraDiscovery
from service.api.context import Context
from service.problems import problem_of
from service.rows import attempts, cameras, jobs
from service.settings import Settings
from service.workers import camera_tasks, sandbox
from service.workers.tasks import CameraOrder, Kind, Limits, Task, Tell

SIM = "sim://studio?width=64&height=64"
AWAY = "ptp+ip://127.0.0.1:1"
PATH = f"/cameras/{cameras.id_of(SIM)}"


def with_cameras(settings: Settings) -> Settings:
    """The settings of a service with both cameras."""
    return settings.model_copy(update={"cameras": f"{SIM} {AWAY}", "queued_jobs_per_key": 10})


def ask_in_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Do what the routes ask of a camera in this process."""
    work: dict[Kind, Callable[[Task, Tell], None]] = {
        "cameras": camera_tasks.find,
        "camera": camera_tasks.describe,
        "camera_settings": camera_tasks.adjust,
    }

    def run(_looking: CameraDiscovery, kind: Kind, order: CameraOrder, trace_id: str = "") -> Any:
        told: list[dict[str, Any]] = []
        try:
            task = Task(kind, "", trace_id, "", Limits(0, 0, 0, 0, 0), {}, order)
            work[kind](Task.from_json(task.to_json()), told.append)
        except drivers.DriverError as error:
            raise sandbox.TaskError(problem_of(error, trace_id).model_dump()) from error
        return json.loads(json.dumps(told[-1]["answer"]))

    monkeypatch.setattr(CameraDiscovery, "_run", run)


def take_release_away(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have simulated cameras take no order to release."""
    encode = DeviceInfo.encode

    def without(info: DeviceInfo) -> bytes:
        offered = tuple(code for code in info.operations if code not in RELEASES)
        return encode(replace(info, operations=offered))

    monkeypatch.setattr(DeviceInfo, "encode", without)


def hold(context: Context, job_id: str) -> jobs.Job:
    """Give a job the camera that it waits for."""
    with context.engine.begin() as connection:
        held = cameras.claim(connection, job_id, "w")
    assert held is not None
    return held


def take(context: Context, job_id: str, settings: dict[str, Any]) -> None:
    """Do a worker's part: take the pair of a job."""
    held = hold(context, job_id)
    inputs = {frame: {"key": frame, "sha256": "0" * 64} for frame in ("no_flash", "flash")}
    with context.engine.begin() as connection:
        assert attempts.set_inputs(connection, held, inputs, 2, settings)
        assert attempts.release(connection, held)

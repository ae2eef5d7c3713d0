"""What the process of a task does with a camera.

A capture asks two questions on the way: {"kind": "operator", "request", "seconds"} whether a person
has done what is requested, and {"kind": "keep", "settings"} whether the pair is kept for good, so
that the card may be cleared.
"""

from __future__ import annotations

import json
import logging
import sys
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any, TypeVar

import drivers
from pipeline.decode import decode
from service.workers.tasks import Adjust, FindCameras, LookAt, TakePair, Task, Tell

Result = TypeVar("Result")

log = logging.getLogger("service.workers.camera_tasks")


def capture(task: Task, tell: Tell) -> None:
    """Take a pair, with the settings asked for, and answer with those that it was taken with."""
    assert isinstance(task.camera, TakePair)
    wanted, stages = task.camera, drivers.CAPTURE_STAGES

    def report(stage: str, fraction: float) -> None:
        tell({"stage": "capture", "fraction": (stages.index(stage) + fraction) / len(stages)})

    with drivers.open_camera(wanted.camera) as camera:
        flash = _flash(wanted, tell)
        pair = drivers.capture_pair(camera, report, flash=flash, settings=wanted.settings)
        directory = Path(task.directory)
        (directory / "no_flash").write_bytes(pair.no_flash.best)
        (directory / "flash").write_bytes(pair.flash.best)
        taken_with = dict(pair.settings)
        if not wanted.keep and _ask(tell, {"kind": "keep", "settings": taken_with}):
            _if_it_can(lambda: pair.delete_from(camera, best_alone=True), task)
        info = _if_it_can(lambda: asdict(camera.info()), task)
        tell({"answer": {"settings": taken_with, "info": info}})


def find(task: Task, tell: Tell) -> None:
    """Answer with the addresses of the cameras that are found here, or also on the network."""
    assert isinstance(task.camera, FindCameras)
    if task.camera.network:
        drivers.listen_to_network()
    tell({"answer": [camera.address for camera in drivers.list_cameras()]})


def describe(task: Task, tell: Tell) -> None:
    """Answer with what a camera tells of itself, and whether it can be released."""
    assert isinstance(task.camera, LookAt)
    with drivers.open_camera(task.camera.camera) as camera:
        info = asdict(camera.info())
        try:
            camera.check_release()
        except drivers.SettingError:
            tell({"answer": {"info": info, "releases": False}})
        else:
            tell({"answer": {"info": info, "releases": True}})


def adjust(task: Task, tell: Tell) -> None:
    """Write settings, and answer with all that the camera has."""
    assert isinstance(task.camera, Adjust)
    with drivers.open_camera(task.camera.camera) as camera:
        drivers.write_settings(camera, task.camera.settings)
        settings = {
            one.name: {"value": one.value, "choices": one.choices, "writable": one.writable}
            for one in camera.settings()
        }
        tell({"answer": {"settings": settings, "info": asdict(camera.info())}})


def brightness(photograph: bytes) -> float:
    """Tell how bright a photograph is in the mean, linear, 1 where it is white."""
    return float(decode(photograph).pixels[:].mean())


def _flash(wanted: TakePair, tell: Tell) -> drivers.Flash:
    if wanted.flash == "external":
        assert wanted.switch is not None  # else the request was refused
        return drivers.ExternalFlash(wanted.switch, brightness, wanted.settle_seconds)
    if wanted.flash == "operator":

        def ask(request: str, seconds: float) -> bool:
            return _ask(tell, {"kind": "operator", "request": request, "seconds": seconds})

        return drivers.OperatorFlash(ask, brightness, wanted.operator_seconds)
    return drivers.PropertyFlash()


def _ask(tell: Tell, question: dict[str, Any]) -> bool:
    tell({"question": question})
    return bool(json.loads(sys.stdin.readline() or "false"))


def _if_it_can(call: Callable[[], Result], task: Task) -> Result | None:
    """Ask a camera for something that its pair, which is taken, does not depend on.

    None, and a line in the log, where it fails.
    """
    try:
        return call()
    except drivers.DriverError as error:
        kind = type(error).__name__
        log.warning("the camera failed after its pair: %s", kind, extra={"job": task.job})
        return None

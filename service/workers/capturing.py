"""The part of an attempt in which a camera takes the job's pair, and its flash is left off."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import drivers
from service.capture import Capture
from service.errors import AttemptError
from service.frames import FRAMES
from service.object_keys import captured_key
from service.problems import problem_of
from service.rows import attempts, cameras, jobs
from service.rows.database import AWAY
from service.settings import Settings
from service.workers import host, sandbox
from service.workers.means import Means
from service.workers.stopping import ASK_SECONDS
from service.workers.tasks import TakePair

_ELSEWHERE = (
    " It was looked for on the worker's host alone, as no API with a worker beside it had seen it "
    "when the capture was sent: if it hangs on another host, run `lightlayers serve` there, ask it "
    "for GET /cameras, and send the capture again."
)


def pair_to_take(job: jobs.Job, settings: Settings) -> TakePair:
    """Make what the process of a job's capture is told."""
    assert job.capture is not None
    asked = Capture(**job.capture)
    return TakePair(
        camera=asked.camera,
        flash=asked.flash,
        settings=asked.settings,
        keep=asked.keep,
        switch=settings.flash_switch,
        settle_seconds=settings.flash_settle_seconds,
        operator_seconds=settings.operator_seconds,
    )


def take_pair(means: Means, directory: Path, run: Callable[[sandbox.Ask], Any]) -> None:
    """Have the camera take the pair, and store it for good.

    run: runs the task in a folder, and gives its answer; service.workers.camera_tasks has the
    questions that it asks. Raises what it raises, unless the pair was kept before, and
    sandbox.StoppedError when the attempt counts no more.
    """
    kept = False

    def ask(question: dict[str, Any], is_void: Callable[[], bool]) -> bool:
        nonlocal kept
        if question["kind"] == "operator":
            return ask_operator(means, question["request"], question["seconds"], is_void)
        kept = _keep_pair(means, directory, question["settings"])
        return kept

    try:
        told = run(ask)
    except (sandbox.TaskError, AttemptError) as error:
        if not kept:
            if isinstance(error, sandbox.TaskError) and _is_elsewhere_perhaps(means, error):
                error.problem["detail"] += _ELSEWHERE
            raise
        means.log.warning("cut short after the pair was kept: %s", type(error).__name__)
        return
    if not kept and not _keep_pair(means, directory, told["settings"]):
        raise sandbox.StoppedError
    if means.job.camera and told["info"]:
        with contextlib.suppress(*AWAY), means.engine.begin() as connection:
            cameras.note(connection, means.job.camera, drivers.CameraInfo(**told["info"]))


@contextlib.contextmanager
def flash_left_off(job: jobs.Job, settings: Settings) -> Iterator[None]:
    """Switch the flash off where the capture's process died before it could do so itself."""
    try:
        yield
    except sandbox.TaskError:  # its process has seen to it
        raise
    except Exception:
        leave_flash_off(job, settings)
        raise


def leave_flash_off(job: jobs.Job, settings: Settings) -> None:
    """Switch off the flash that a capture of this job may have left on, if it has a switch."""
    wanted = pair_to_take(job, settings)
    if wanted.flash == "external" and wanted.switch is not None:
        drivers.leave_flash_off(wanted.switch)


def ask_operator(means: Means, request: str, seconds: float, is_void: Callable[[], bool]) -> bool:
    """Wait for a person, whom the job's row asks; whether it was confirmed in time.

    is_void: whether nobody wants the answer any more.
    """

    def ask() -> None:
        with means.engine.begin() as connection:
            attempts.ask_operator(connection, means.job, request, seconds)

    def look() -> bool | None:
        with means.engine.begin() as connection:
            return attempts.confirmed(connection, means.job)

    means.patiently(ask)
    while (done := means.patiently(look)) is None and not is_void():
        means.stopping.pause(ASK_SECONDS)
    return bool(done)


def _keep_pair(means: Means, directory: Path, settings: dict[str, Any]) -> bool:
    """Store a pair for good and write that the job has it; false when this counts no more."""
    inputs = {}
    for frame in FRAMES:
        key = captured_key(means.job.id, means.job.attempt, frame)
        inputs[frame] = {"key": key, "sha256": means.keep(key, directory / frame)}
    size = sum((directory / frame).stat().st_size for frame in FRAMES)

    def write() -> bool:
        with means.engine.begin() as connection:
            return attempts.set_inputs(connection, means.job, inputs, size, settings)

    return means.patiently(write)


def _is_elsewhere_perhaps(means: Means, error: sandbox.TaskError) -> bool:
    """Whether a camera that was not found here may be on another host's USB."""
    here, camera = host.of_usb(means.engine), means.job.camera
    not_found = error.problem["type"] == problem_of(drivers.CameraNotFoundError(), "").type
    if not (not_found and here and camera):
        return False
    with means.engine.connect() as connection:
        return cameras.may_be_elsewhere(connection, camera, here)

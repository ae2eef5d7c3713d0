"""Makes jobs of requests for captures: each waits in the queue of its camera."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import sqlalchemy as sa
from pydantic import BaseModel

import drivers
from pipeline.errors import OptionError, counted
from pipeline.options import Options
from service.allowed import check_camera, check_flash, check_webhook
from service.api.accepted_job import Accepted
from service.api.admission import replay_or_admit
from service.api.callers import Caller, find
from service.api.commit_job import make_row
from service.api.context import Context
from service.api.idempotency import as_asked, digest, hash_of, replay
from service.api.intake import Intake, handling_of
from service.api.models import CameraCapture, Handling
from service.api.named_calibrations import complete
from service.api.submission import Submission
from service.capture import Capture, Taking
from service.errors import CameraHeldError, EndedError, ForeignCameraError, NotReadyError
from service.rows import bursts, cameras, jobs
from service.rows.keys import Scope
from service.sentences import in_words
from service.spectra import check_spectra

PROBLEMS = (
    drivers.BadAddressError,
    drivers.CameraNotFoundError,
    drivers.SettingError,
    CameraHeldError,
    ForeignCameraError,
)
"""What a capture that a job or a calibration begins with may be refused for."""


_BURST_BYTES = 8 * 1024 * 1024  # of the options of all its jobs


@dataclass(frozen=True)
class Pairs:
    """What is wanted of a camera. interval_seconds: between the moments they are due."""

    capture: Capture
    options: BaseModel
    handling: Handling
    count: int = 1
    interval_seconds: float = 0.0


def accept_capture(submission: Submission, wanted: Intake) -> Accepted:
    """Queue one pair.

    Raises ForbiddenError, ForeignCameraError, CameraHeldError, OptionError, and what complete
    and replay_or_admit raise.
    """
    submission.caller.need(Scope.CAPTURE)
    assert wanted.capture is not None
    request_hash = hash_of(wanted)
    if earlier := replay_or_admit(submission, request_hash):
        return earlier
    options = complete(submission.context, submission.caller, wanted.options, wanted.calibrations)
    pairs = Pairs(wanted.capture, options, wanted.handling)
    return _commit(submission, pairs, request_hash)


def accept_captures(
    submission: Submission, camera: str, wanted: CameraCapture, named: dict[str, Any]
) -> Accepted:
    """Queue a burst of pairs of the camera at an address; the first of its jobs that is kept.

    named: calibrations, as an Intake has them. Raises UnknownJobError, OptionError, NotReadyError
    and EndedError for a job that none can be like, and what accept_capture raises.
    """
    asked = as_asked(wanted)
    options = asked.pop("options", {}) | named
    request_hash = digest({"camera": camera, "wanted": asked | {"options": options}})
    if earlier := replay_or_admit(submission, request_hash, wanted.pairs):
        return earlier
    pairs = _pairs(submission.context, submission.caller, camera, wanted, named)
    return _commit(submission, pairs, request_hash)


def _pairs(
    context: Context, caller: Caller, camera: str, wanted: CameraCapture, named: dict[str, Any]
) -> Pairs:
    given = wanted.model_dump(include=set(Taking.model_fields), exclude_unset=True)
    options = complete(context, caller, wanted.options, named)
    if wanted.like is not None:
        like, same = _recipe(context, caller, wanted.like)
        if "options" not in wanted.model_fields_set:
            options = same
        given = like | given | {"settings": like["settings"] | given.get("settings", {})}
    with in_words():  # a camera may have said what no request can ask for
        capture = Capture.model_validate(given | {"camera": camera})
    return Pairs(capture, options, handling_of(wanted), wanted.pairs, wanted.interval_seconds)


def _recipe(context: Context, caller: Caller, job_id: str) -> tuple[dict[str, Any], Options]:
    """Flash and settings of a job's capture, and its options."""
    with context.engine.connect() as connection:
        source = find(connection, caller, job_id)
    if source.capture is None or source.task != "separate":
        raise OptionError(
            "like: the job separates no pair that a camera takes; name one that does."
        )
    if source.camera_settings is None and source.ended:
        raise EndedError("like: the job has ended, and its pair was never taken; name another.")
    if source.camera_settings is None:
        raise NotReadyError("like: the pair of this job is not taken yet.")
    recipe = {name: source.capture[name] for name in ("flash", "keep") if name in source.capture}
    with in_words():
        return recipe | {"settings": source.camera_settings}, Options.model_validate(source.options)


def _commit(submission: Submission, wanted: Pairs, request_hash: str) -> Accepted:
    """Commit rows and queue entries together."""
    context = submission.context
    check_spectra(wanted.options)
    check_camera(context.settings, wanted.capture.camera)
    drivers.check_settings(wanted.capture.settings)
    check_flash(context.settings, wanted.capture.flash)
    check_webhook(context.settings, wanted.handling.webhook_url)
    ids = bursts.new_ids(wanted.count)
    values = {"request_hash": request_hash, "capture": _row_of(wanted.capture)}
    row = make_row(submission, values, wanted.options, wanted.handling)
    _refuse_large(row["options"], wanted.count)
    try:
        with context.engine.begin() as connection:
            row["camera"] = cameras.add(connection, wanted.capture.camera)
            if wanted.capture.when_busy == "refuse":
                _refuse_when_held(connection, submission.caller, row["camera"])
            _add(context, connection, wanted, row, ids)
    except (sa.exc.IntegrityError, CameraHeldError):  # perhaps by this request, sent twice
        earlier = replay(submission, request_hash)
        if earlier is None:
            raise
        return earlier
    return Accepted(ids[0], replayed=False)


def _refuse_large(options: dict[str, Any], pairs: int) -> None:
    """Refuse a small request that would fill the database, as each job has its own options."""
    size = len(json.dumps(options)) * pairs
    if size > _BURST_BYTES:
        raise OptionError(
            f"options: for {pairs} pairs they take {size:,} bytes of {_BURST_BYTES:,}: name a "
            "calibration in place of tables, or ask for fewer pairs."
        )


def _add(
    context: Context,
    connection: sa.Connection,
    wanted: Pairs,
    row: dict[str, Any],
    ids: list[str],
) -> None:
    """Add rows and queue entries of a burst, whose first job alone bears the idempotency key."""
    deadline = wanted.handling.deadline_seconds
    delays = [number * wanted.interval_seconds for number in range(len(ids))]
    rows = [row | {"id": ids[0]}]
    rows += [row | {"id": job_id, "idempotency_key": None} for job_id in ids[1:]]
    deadlines = [None if deadline is None else deadline + delay for delay in delays]
    ranks = jobs.add_burst(connection, list(zip(rows, deadlines, strict=True)))
    camera = row["camera"]
    on = cameras.host_of(connection, camera)
    for job_id, rank, delay in zip(ids, ranks, delays, strict=True):
        context.queue.submit_capture(connection, job_id, rank, camera, on, delay)


def _refuse_when_held(connection: sa.Connection, caller: Caller, camera: str) -> None:
    holder = cameras.holder(connection, camera)
    if holder:
        raise CameraHeldError(f"{told_of(holder, caller)} has the camera; try again when it ends.")
    if waiting := cameras.count_waiting(connection, camera):
        wait = counted(waiting, "capture waits", "captures wait")
        raise CameraHeldError(f"{wait} for the camera; try again later.")


def told_of(holder: jobs.Job, caller: Caller) -> str:
    """Name the job that holds a camera, to who may know of it."""
    return f"The job {holder.id}" if caller.may_see(holder) else "A job of another key"


def _row_of(capture: Capture) -> dict[str, Any]:
    return capture.model_dump(mode="json", exclude_defaults=True)

"""Calibrations that jobs have made for a camera and a set-up."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

import sqlalchemy as sa

from pipeline.calibration.kept_calibrations import DEFAULT_SETUP, Kept
from pipeline.options import NO_SETUP
from pipeline.taken_with import TakenWith
from service.rows import jobs
from service.rows.jobs import Job

_CAMERA = "camera"  # in the column `inputs` of a calibration, beside its photographs


def for_separation(connection: sa.Connection, job: Job) -> list[Job]:
    """The newest calibration of each kind and camera in the set-up that a separation names."""
    setup = job.options.get("setup", DEFAULT_SETUP)
    if setup == NO_SETUP:
        return []
    newest: dict[tuple[str, TakenWith], Job] = {}
    for row in jobs.kept_calibrations(connection, job.owner, setup):
        newest.setdefault((row.options["kind"], taken_with(row)), row)
    return list(newest.values())


def taken_with(row: Job) -> TakenWith:
    """The camera of a calibration that has succeeded."""
    return TakenWith.model_validate((row.inputs or {}).get(_CAMERA, {}))


def with_camera(inputs: dict[str, Any], camera: dict[str, Any]) -> dict[str, Any]:
    """Give the inputs of a calibration with the camera that taken_with() finds in its row."""
    return inputs | {_CAMERA: camera}


def made_at(row: Job) -> str:
    """When a calibration was made, ISO 8601."""
    return datetime.fromtimestamp(row.finished or row.created, UTC).isoformat(timespec="seconds")


def made_of(row: Job, content: bytes) -> Kept:
    """Make what a separation takes of a calibration and its file."""
    return Kept(
        kind=row.options["kind"],
        setup=row.options["setup"],
        name=row.id,
        made=made_at(row),
        taken_with=taken_with(row),
        content=content.decode(),
    )

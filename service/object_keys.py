"""Where in the store everything of jobs and uploads lies: the keys of their objects."""

from __future__ import annotations

from typing import Any

from service.frames import FRAMES

JOBS = "jobs/"
"""What the keys of all jobs' objects begin with."""

UPLOADS = "uploads/"
"""What the keys of all pieces of uploads begin with."""

DATABASE_ID = "database-id"
"""The object that names the database whose store this is."""


def job_key(job_id: str) -> str:
    """Where everything of a job lies: the prefix of its objects."""
    return f"{JOBS}{job_id}/"


def inputs_key(job_id: str, frame: str) -> str:
    """Where a job's photograph lies; frame is one of FRAMES."""
    return f"{job_key(job_id)}inputs/{frame}"


def results_key(job_id: str, attempt: int, name: str = "") -> str:
    """Where a result of an attempt lies; without a name, the prefix of all of them."""
    return f"{job_key(job_id)}{attempt}/{name}"


def captured_key(job_id: str, attempt: int, frame: str = "") -> str:
    """Where a photograph lies that an attempt had a camera take; without a frame, their prefix.

    Each attempt has its own place, so that two of them never make one pair.
    """
    return f"{job_key(job_id)}inputs/{attempt}/{frame}"


def upload_key(upload_id: str, piece: str = "") -> str:
    """Where a piece of an upload lies; without its name, the prefix of all of them."""
    return f"{UPLOADS}{upload_id}/{piece}"


def describe_inputs(job_id: str, sha256: dict[str, str]) -> dict[str, Any]:
    """Make the `inputs` column for two photographs in the store, given their digests by frame."""
    return {frame: {"key": inputs_key(job_id, frame), "sha256": sha256[frame]} for frame in FRAMES}

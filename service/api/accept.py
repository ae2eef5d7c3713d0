"""Makes a job of a request: checks the pair, stores it, queues it."""

from __future__ import annotations

import hashlib
import json
import shutil
import uuid
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import sqlalchemy as sa
from obstore.exceptions import BaseError
from pydantic import BaseModel

from service import jobs, sandbox, scratch
from service.api.callers import Caller
from service.api.context import Context
from service.api.intake import Intake
from service.api.models import Handling
from service.attempt import FRAMES, describe_inputs, inputs_key, job_key
from service.errors import IdempotencyError, QueueFullError, StorageFullError

_CHECK_SECONDS = 30.0


@dataclass(frozen=True)
class Accepted:
    """The job of a request; replayed when an earlier request with its key made it."""

    job_id: str
    replayed: bool

    @property
    def headers(self) -> dict[str, str]:
        """Headers of the 202."""
        location = {"Location": f"/jobs/{self.job_id}"}
        return location | ({"Idempotency-Replayed": "true"} if self.replayed else {})


def refuse_when_full(context: Context, caller: Caller, idempotency_key: str | None) -> None:
    """Refuse a new job where there is no room for it: before its body is read, and once it is.

    idempotency_key: one that made a job already passes. Raises QueueFullError when as many jobs
    wait as may, of this caller or in all, StorageFullError when the store's disk is nearly full.
    """
    if _job_of(context, caller, idempotency_key):
        return
    with context.engine.connect() as connection:
        own = jobs.count_queued(connection, caller.owner)
        waiting = jobs.count_queued(connection)
    if own >= context.settings.queued_jobs_per_key:
        raise QueueFullError(f"{own} jobs of yours wait already; send this one again later.")
    if waiting >= context.settings.queued_jobs:
        raise QueueFullError(f"{waiting} jobs wait already; send this one again later.")
    free = context.storage.free_bytes()
    if free is not None and free < context.settings.free_bytes:
        raise StorageFullError(
            "The store of photographs is nearly full; delete jobs, or send this one again later."
        )


def accept(
    context: Context,
    caller: Caller,
    wanted: Intake,
    idempotency_key: str | None,
    trace_id: str,
) -> Accepted:
    """Store the pair for good, then commit row and queue entry together.

    An idempotency_key that made a job already gives that job; of requests that come at once, one
    makes it. Raises IdempotencyError when that job was another one, TaskError when the headers of
    the pair cannot be used, and what refuse_when_full raises.
    """
    refuse_when_full(context, caller, idempotency_key)  # an upload may have taken long
    job_id = uuid.uuid4().hex
    sha256 = _store_pair(context, job_id, wanted, trace_id) if wanted.files else {}
    same = {
        "options": wanted.options.model_dump(mode="json"),
        "handling": wanted.handling.model_dump(mode="json"),
        "capture": wanted.capture,
        "sha256": sha256,
    }
    values = {
        "id": job_id,
        "trace_id": trace_id,
        "capture": wanted.capture,
        "inputs": describe_inputs(job_id, sha256) if sha256 else None,
        "idempotency_key": idempotency_key,
        "request_hash": digest(same),
    }
    return commit(context, caller, values, wanted.options, wanted.handling)


def commit(
    context: Context,
    caller: Caller,
    values: dict[str, Any],
    options: BaseModel,
    handling: Handling,
) -> Accepted:
    """Commit row and queue entry of a job whose files are stored; without it, remove the files.

    values: of the row, as far as the other arguments do not give them. Raises IdempotencyError.
    """
    row = values | {
        "owner": caller.owner,
        "options": options.model_dump(mode="json", exclude_unset=True),
        "priority": handling.priority,
        "webhook": handling.webhook and handling.webhook.model_dump(),
    }
    try:
        with context.engine.begin() as connection:
            rank = jobs.add(connection, row, handling.deadline_seconds)
            context.queue.submit(connection, row["id"], rank)
    except sa.exc.IntegrityError:
        context.storage.delete_below(job_key(row["id"]))
        earlier = replay(context, caller, row["idempotency_key"], row["request_hash"])
        if earlier is None:  # it was deleted at this moment: a 503, and the next try finds no row
            raise
        return earlier
    return Accepted(row["id"], replayed=False)


def replay(
    context: Context, caller: Caller, idempotency_key: str | None, request_hash: str
) -> Accepted | None:
    """Give the job that a request with this key has made. Raises IdempotencyError."""
    earlier = _job_of(context, caller, idempotency_key)
    if earlier is None:
        return None
    if earlier.request_hash != request_hash:
        raise IdempotencyError(
            "This Idempotency-Key belongs to a request with another pair or other options; "
            "use a new key."
        )
    return Accepted(earlier.id, replayed=True)


def digest(same: dict[str, Any]) -> str:
    """Digest what two requests share when they ask for the same."""
    return hashlib.sha256(json.dumps(same, sort_keys=True).encode()).hexdigest()


def _store_pair(context: Context, job_id: str, wanted: Intake, trace_id: str) -> dict[str, str]:
    with scratch.folder(context.settings.data_dir) as directory:
        for frame in FRAMES:
            with (directory / frame).open("wb") as target:
                shutil.copyfileobj(wanted.files[frame].file, target)
        _check(context, job_id, directory, trace_id)
        try:
            sha256 = {
                frame: context.storage.put_file(inputs_key(job_id, frame), directory / frame)
                for frame in FRAMES
            }
            context.storage.flush(inputs_key(job_id, frame) for frame in FRAMES)
        except BaseError:
            context.storage.delete_below(job_key(job_id))
            raise
    return sha256


def _check(context: Context, job_id: str, directory: Path, trace_id: str) -> None:
    task = sandbox.Task(
        kind="check",
        job=job_id,
        trace_id=trace_id,
        directory=str(directory),
        limits=sandbox.Limits.of(context.settings, _CHECK_SECONDS),
        options={},
        capture=None,
    )
    with context.checks:
        sandbox.run(
            task, _CHECK_SECONDS, lambda _stage, _fraction: None, lambda: False, context.fork_server
        )


def _job_of(context: Context, caller: Caller, idempotency_key: str | None) -> jobs.Job | None:
    if idempotency_key is None:
        return None
    with context.engine.connect() as connection:
        return jobs.find_by_key(connection, caller.owner, idempotency_key)

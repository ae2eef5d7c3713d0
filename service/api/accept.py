"""Makes a job of a request: checks the pair, stores it, queues it."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import uuid
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import sqlalchemy as sa
from obstore.exceptions import BaseError

from pipeline.errors import OptionError, UnreadableImageError
from service import eta, jobs, quotas, sandbox, tracing, uploads
from service.addresses import ForbiddenAddressError, check_url, parse_networks
from service.api.callers import Caller
from service.api.context import Context
from service.api.intake import Intake
from service.api.models import Handling
from service.api.uploaded import bring_uploaded, take_over
from service.attempt import FRAMES, describe_inputs, inputs_key
from service.errors import (
    CrashError,
    IdempotencyError,
    QueueFullError,
    QuotaError,
    StorageFullError,
    StoredQuotaError,
)
from service.keys import Scope

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
    wait as may, StorageFullError when the store's disk is nearly full, and what quotas.check
    raises.
    """
    if _job_of(context, caller, idempotency_key):
        return
    with context.engine.connect() as connection:
        quotas.check(connection, caller.owner)
        waiting = jobs.count_queued(connection)
    if waiting >= context.settings.queued_jobs:
        raise QueueFullError(f"{waiting} jobs wait already; send this one again later.")
    refuse_when_disk_full(context)


def refuse_when_disk_full(context: Context) -> None:
    """Raise StorageFullError when the store's disk is nearly full."""
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
    makes it. Raises ForbiddenError when the key is not for it, IdempotencyError when that job was
    another one, OptionError and UnfinishedUploadError for uploads that cannot be used, TaskError
    when the headers of the pair cannot be, OptionError when the webhook is one that is not called,
    and what refuse_when_full raises.
    """
    caller.need(Scope.CAPTURE if wanted.capture else Scope.SUBMIT)
    refuse_when_full(context, caller, idempotency_key)  # an upload may have taken long
    _check_webhook(context, wanted.handling)
    request_hash = _request_hash(wanted)
    if earlier := _job_of(context, caller, idempotency_key):
        return _replayed(earlier, request_hash)
    job_id = uuid.uuid4().hex
    try:
        sent = wanted.sha256 or wanted.uploads
        sha256 = _store_pair(context, caller, job_id, wanted, trace_id) if sent else {}
        options = wanted.options.model_dump(mode="json", exclude_unset=True)
        stored = sum((wanted.directory / frame).stat().st_size for frame in FRAMES if sha256)
        values: dict[str, Any] = {
            "id": job_id,
            "owner": caller.owner,
            "options": options,
            "likeness": eta.likeness(options, stored, wanted.capture),
            "priority": wanted.handling.priority,
            "webhook": wanted.handling.webhook and wanted.handling.webhook.model_dump(),
            "capture": wanted.capture,
            "inputs": describe_inputs(job_id, sha256) if sha256 else None,
            "stored_bytes": stored,
            "trace_id": trace_id,
            "span_id": tracing.span_id(),
            "idempotency_key": idempotency_key,
            "request_hash": request_hash,
        }
        with context.engine.begin() as connection:
            jobs.add(connection, values)
            context.queue.submit(connection, job_id)
            take_over(connection, caller, wanted.uploads)
    except (QuotaError, StoredQuotaError):
        context.storage.delete_below(f"jobs/{job_id}/")
        raise
    except (sa.exc.IntegrityError, OptionError):
        context.storage.delete_below(f"jobs/{job_id}/")
        earlier = _job_of(context, caller, idempotency_key)
        if earlier is None:  # what made it fail is gone, or it did not fail over the key
            raise
        return _replayed(earlier, request_hash)
    with contextlib.suppress(BaseError):  # what stays is removed as pieces without an upload
        for upload_id in wanted.uploads.values():
            uploads.delete_parts(context.storage, upload_id)
    return Accepted(job_id, replayed=False)


def _check_webhook(context: Context, handling: Handling) -> None:
    if handling.webhook is None:
        return
    allowed = parse_networks(context.settings.webhook_private)
    try:
        check_url(handling.webhook.url, allowed, context.settings.webhook_https)
    except ForbiddenAddressError as error:
        raise OptionError(f"webhook.url: {error}.") from error


def _replayed(earlier: jobs.Job, request_hash: str) -> Accepted:
    if earlier.request_hash != request_hash:
        raise IdempotencyError(
            "This Idempotency-Key belongs to a request with another pair or other options; "
            "use a new key."
        )
    return Accepted(earlier.id, replayed=True)


def _store_pair(
    context: Context, caller: Caller, job_id: str, wanted: Intake, trace_id: str
) -> dict[str, str]:
    directory = wanted.directory
    sha256 = wanted.sha256 or bring_uploaded(context, caller, wanted.uploads, directory)
    _check(context, job_id, directory, trace_id)
    try:
        for frame in FRAMES:
            context.storage.put(inputs_key(job_id, frame), directory / frame)
        context.storage.flush(inputs_key(job_id, frame) for frame in FRAMES)
    except BaseError:
        context.storage.delete_below(f"jobs/{job_id}/")
        raise
    return sha256


def _check(context: Context, job_id: str, directory: Path, trace_id: str) -> None:
    task = sandbox.Task(
        kind="check",
        job=job_id,
        trace_id=trace_id,
        directory=str(directory),
        memory_bytes=context.settings.job_memory_bytes,
        cpu_seconds=int(_CHECK_SECONDS * (os.cpu_count() or 1)),
        options={},
        capture=None,
    )
    with context.checks:
        try:
            sandbox.run(
                task,
                _CHECK_SECONDS,
                lambda _stage, _fraction: None,
                lambda: False,
                context.fork_server,
            )
        except CrashError as error:
            raise UnreadableImageError(
                "The program that reads the headers of photographs crashed on these: they are "
                "damaged, or of a kind that is not read; if both open elsewhere, report it."
            ) from error


def _request_hash(wanted: Intake) -> str:
    """Digest what two requests share when they ask for the same: options, and pair or camera."""
    same = {
        "options": wanted.options.model_dump(mode="json"),
        "handling": wanted.handling.model_dump(mode="json"),
        "capture": wanted.capture,
        "sha256": wanted.sha256,
        "uploads": wanted.uploads,  # their bytes never change, and go when a job is made of them
    }
    return hashlib.sha256(json.dumps(same, sort_keys=True).encode()).hexdigest()


def _job_of(context: Context, caller: Caller, idempotency_key: str | None) -> jobs.Job | None:
    if idempotency_key is None:
        return None
    with context.engine.connect() as connection:
        return jobs.find_by_key(connection, caller.owner, idempotency_key)

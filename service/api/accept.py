"""Makes a job of a request: checks the pair, stores it, queues it."""

from __future__ import annotations

import contextlib
import hashlib
import json
import uuid
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import sqlalchemy as sa
from obstore.exceptions import BaseError
from pydantic import BaseModel

from pipeline.errors import OptionError, UnreadableImageError
from service import eta, jobs, quotas, sandbox, tracing, uploads
from service.addresses import ForbiddenAddressError, check_url, parse_networks
from service.api.calibrated import complete
from service.api.callers import Caller
from service.api.context import Context
from service.api.intake import Intake
from service.api.models import Handling
from service.api.uploaded import bring_uploaded, take_over
from service.errors import (
    AttemptError,
    CrashError,
    FileLimitError,
    IdempotencyError,
    KilledError,
    MemoryLimitError,
    OutputLimitError,
    QueueFullError,
    QuotaError,
    StorageFullError,
    StoredQuotaError,
    TimeLimitError,
    UnreadyError,
)
from service.frames import FRAMES
from service.keys import Scope
from service.object_keys import describe_inputs, inputs_key, job_key

_CHECK_SECONDS = 30.0
_DYING: dict[type[AttemptError], str] = {
    CrashError: "The program that reads the headers of photographs crashed on these",
    MemoryLimitError: "The headers of these photographs want more memory than a job may have",
    FileLimitError: "The headers of these photographs want more open files than a job may have",
    OutputLimitError: "These photographs are larger than what a job may write",
}
_BUSY: dict[type[AttemptError], str] = {
    TimeLimitError: f"The headers of these photographs were not read within {_CHECK_SECONDS:g} s",
    KilledError: "The system killed the program that reads the headers of these photographs",
}
"""What a sound pair meets, too, where the machine has too much to do or too little memory."""


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


def refuse_when_full(
    context: Context, caller: Caller, idempotency_key: str | None, coming: int = 1
) -> None:
    """Refuse new jobs where there is no room for them: before their body is read, and once it is.

    idempotency_key: one that made a job already passes. coming: how many jobs. Raises
    QueueFullError when as many jobs wait as may, of this caller or in all, StorageFullError when
    the store's disk is nearly full, and what quotas.check raises.
    """
    if _job_of(context, caller, idempotency_key):
        return
    with context.engine.connect() as connection:
        quotas.check(connection, caller.owner, coming)
        own = jobs.count_queued(connection, caller.owner)
        waiting = jobs.count_queued(connection)
    of_key, in_all = context.settings.queued_jobs_per_key, context.settings.queued_jobs
    if own + coming > of_key:
        raise QueueFullError(_full(f"{own} jobs of yours wait already", coming, of_key))
    if waiting + coming > in_all:
        raise QueueFullError(_full(f"{waiting} jobs wait already", coming, in_all))
    refuse_when_disk_full(context)


def _full(said: str, coming: int, limit: int) -> str:
    if coming == 1:
        return f"{said}; send this one again later."
    return f"{said}, and {limit} may; ask for fewer than these {coming}, or later."


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
    makes it. Raises ForbiddenError when the key is not for it, OptionError and
    UnfinishedUploadError for uploads that cannot be used, what complete raises, TaskError or
    UnreadableImageError when the headers of the pair cannot be, UnreadyError when they were not
    read for want of time or memory, and what refuse_when_full, replay and commit raise.
    """
    caller.need(Scope.SUBMIT)
    refuse_when_full(context, caller, idempotency_key)  # an upload may have taken long
    check_webhook(context, wanted.handling)
    request_hash = hash_of(wanted)
    if earlier := replay(context, caller, idempotency_key, request_hash):
        return earlier
    options = complete(context, caller, wanted.options, wanted.calibrations)
    job_id = uuid.uuid4().hex
    sha256: dict[str, str] = {}
    if wanted.sha256 or wanted.uploads:
        try:
            sha256 = _store_pair(context, caller, job_id, wanted, trace_id)
        except OptionError:  # another request with this key may have taken the uploads just now
            if earlier := replay(context, caller, idempotency_key, request_hash):
                return earlier
            raise
    values = {
        "id": job_id,
        "trace_id": trace_id,
        "inputs": describe_inputs(job_id, sha256) if sha256 else None,
        "stored_bytes": sum((wanted.directory / frame).stat().st_size for frame in sha256),
        "idempotency_key": idempotency_key,
        "request_hash": request_hash,
    }
    return commit(context, caller, values, options, wanted.handling, wanted.uploads)


def hash_of(wanted: Intake) -> str:
    """Digest a request for one job."""
    return digest(
        {
            # As they were sent: calibrations that they name may have been deleted since.
            "options": as_asked(wanted.options) | wanted.calibrations,
            "handling": as_asked(wanted.handling),
            "capture": wanted.capture and as_asked(wanted.capture),
            "sha256": wanted.sha256,
            # Their bytes never change, and they go when a job is made of them.
            "uploads": wanted.uploads,
        }
    )


def commit(
    context: Context,
    caller: Caller,
    values: dict[str, Any],
    options: BaseModel,
    handling: Handling,
    taken: Mapping[str, str],
) -> Accepted:
    """Commit row and queue entry of a job whose files are stored; without it, remove the files.

    values: of the row, as far as the other arguments do not give them. taken: ids of uploads that
    the job takes over, by frame. Raises IdempotencyError, QuotaError, StoredQuotaError, and
    OptionError for uploads that are gone.
    """
    row = make_row(caller, values, options, handling)
    try:
        with context.engine.begin() as connection:
            take_over(connection, caller, taken)  # first, so that their bytes count once
            rank = jobs.add(connection, row, handling.deadline_seconds)
            context.queue.submit(connection, row["id"], rank)
    except (QuotaError, StoredQuotaError):
        context.storage.delete_below(job_key(row["id"]))
        raise
    except (sa.exc.IntegrityError, OptionError):
        context.storage.delete_below(job_key(row["id"]))
        earlier = replay(context, caller, row["idempotency_key"], row["request_hash"])
        if earlier is None:  # what made it fail is gone, or it did not fail over the key
            raise
        return earlier
    with contextlib.suppress(BaseError):  # what stays is removed as pieces without an upload
        for upload_id in taken.values():
            uploads.delete_parts(context.storage, upload_id)
    return Accepted(row["id"], replayed=False)


def make_row(
    caller: Caller, values: dict[str, Any], options: BaseModel, handling: Handling
) -> dict[str, Any]:
    """Make the row of a job; values: what the other arguments do not give of it."""
    asked = options.model_dump(mode="json", exclude_unset=True)
    return values | {
        "owner": caller.owner,
        "options": asked,
        "likeness": eta.likeness(asked, values.get("stored_bytes", 0), values.get("capture")),
        "priority": handling.priority,
        "webhook": handling.webhook and handling.webhook.model_dump(),
        "span_id": tracing.span_id(),
    }


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


def as_asked(wanted: BaseModel) -> dict[str, Any]:
    """What a request asks for, to be digested."""
    # Without defaults, else a release that adds an option took no request for an earlier one.
    return wanted.model_dump(mode="json", exclude_defaults=True)


def digest(same: dict[str, Any]) -> str:
    """Digest what two requests share when they ask for the same."""
    return hashlib.sha256(json.dumps(same, sort_keys=True).encode()).hexdigest()


def check_webhook(context: Context, handling: Handling) -> None:
    """Refuse a webhook that is not called. Raises OptionError."""
    if handling.webhook is None:
        return
    allowed = parse_networks(context.settings.webhook_private)
    try:
        check_url(handling.webhook.url, allowed, context.settings.webhook_https)
    except ForbiddenAddressError as error:
        raise OptionError(f"webhook.url: {error}.") from error


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
    except (BaseError, StorageFullError):
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
        try:
            sandbox.run(
                task,
                _CHECK_SECONDS,
                lambda _stage, _fraction: None,
                lambda: False,
                context.fork_server,
            )
        except ChildProcessError as error:
            raise UnreadyError(
                "The program that reads the headers of photographs was ended; send them again."
            ) from error
        except tuple(_BUSY) as error:
            raise UnreadyError(
                f"{_BUSY[type(error)]}: the machine is overloaded, or they are damaged; send them "
                "again, and if only this pair meets that each time, report it."
            ) from error
        except AttemptError as error:
            raise UnreadableImageError(
                f"{_DYING[type(error)]}: they are damaged, or of a kind that is not read; if both "
                "open elsewhere, report it."
            ) from error


def _job_of(context: Context, caller: Caller, idempotency_key: str | None) -> jobs.Job | None:
    if idempotency_key is None:
        return None
    with context.engine.connect() as connection:
        return jobs.find_by_key(connection, caller.owner, idempotency_key)

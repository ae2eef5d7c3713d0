"""Makes a job of a pair that was sent: checks it, stores it, queues it."""

from __future__ import annotations

import uuid
from pathlib import Path

from obstore.exceptions import BaseError

from pipeline.errors import OptionError, UnreadableImageError
from service.allowed import check_webhook
from service.api.accepted_job import Accepted
from service.api.admission import replay_or_admit
from service.api.commit_job import commit
from service.api.context import Context
from service.api.idempotency import hash_of, replay
from service.api.intake import Intake
from service.api.named_calibrations import complete
from service.api.submission import Submission
from service.api.uploaded_pairs import bring_uploaded
from service.errors import (
    AttemptError,
    KilledError,
    StorageFullError,
    TimeLimitError,
    UnreadyError,
)
from service.frames import FRAMES
from service.object_keys import describe_inputs, inputs_key, job_key
from service.rows.keys import Scope
from service.spectra import check_spectra
from service.workers import sandbox
from service.workers.tasks import Limits, Task

_CHECK_SECONDS = 30.0
_BUSY = (TimeLimitError, KilledError)
"""What a sound pair meets, too, where the machine has too much to do or too little memory."""


def accept_pair(submission: Submission, wanted: Intake) -> Accepted:
    """Store the pair for good, then commit row and queue entry together.

    An idempotency key that made a job already gives that job; of requests that come at once, one
    makes it. Raises ForbiddenError when the key is not for it, OptionError and
    UnfinishedUploadError for uploads that cannot be used, what complete and check_spectra raise,
    TaskError or UnreadableImageError when the headers of the pair cannot be, UnreadyError when they
    were not read for want of time or memory, NoProcessError, and what replay_or_admit and commit
    raise.
    """
    context, caller = submission.context, submission.caller
    caller.need(Scope.SUBMIT)
    request_hash = hash_of(wanted)
    # The second look for room: an upload may have taken long.
    if earlier := replay_or_admit(submission, request_hash):
        return earlier
    # After the replay: settings may have allowed it then.
    check_webhook(context.settings, wanted.handling.webhook_url)
    options = complete(context, caller, wanted.options, wanted.calibrations)
    check_spectra(options)
    job_id = uuid.uuid4().hex
    try:
        sha256 = _store_pair(submission, job_id, wanted)
    except OptionError:  # another request with this key may have taken the uploads just now
        if earlier := replay(submission, request_hash):
            return earlier
        raise
    values = {
        "id": job_id,
        "inputs": describe_inputs(job_id, sha256),
        "stored_bytes": sum((wanted.directory / frame).stat().st_size for frame in FRAMES),
        "request_hash": request_hash,
    }
    return commit(submission, values, options, wanted.handling, wanted.uploads)


def _store_pair(submission: Submission, job_id: str, wanted: Intake) -> dict[str, str]:
    context, directory = submission.context, wanted.directory
    sha256 = wanted.sha256 or bring_uploaded(context, submission.caller, wanted.uploads, directory)
    _check(context, job_id, directory, submission.trace_id)
    try:
        for frame in FRAMES:
            context.storage.put(inputs_key(job_id, frame), directory / frame)
        context.storage.flush(inputs_key(job_id, frame) for frame in FRAMES)
    except (BaseError, StorageFullError):
        context.storage.delete_below(job_key(job_id))
        raise
    return sha256


def _check(context: Context, job_id: str, directory: Path, trace_id: str) -> None:
    task = Task(
        kind="check",
        job=job_id,
        trace_id=trace_id,
        directory=str(directory),
        limits=Limits.of(context.settings, _CHECK_SECONDS),
        options={},
    )
    with context.checks:
        try:
            sandbox.run(
                task,
                lambda _stage, _fraction: None,
                lambda: False,
                context.fork_server,
            )
        except ChildProcessError as error:
            raise UnreadyError(
                "The program that reads the headers of photographs was ended; send them again."
            ) from error
        except _BUSY as error:
            raise UnreadyError(str(error)) from error
        except AttemptError as error:
            raise UnreadableImageError(str(error)) from error

"""Commits the job of a request: its row, and its entry in the queue."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from typing import Any

import sqlalchemy as sa
from obstore.exceptions import BaseError
from pydantic import BaseModel

from pipeline.errors import OptionError
from service import tracing, upload_pieces
from service.api.accepted_job import Accepted
from service.api.idempotency import replay
from service.api.models import Handling
from service.api.submission import Submission
from service.api.uploaded_pairs import take_over
from service.errors import QuotaError, StoredQuotaError
from service.object_keys import job_key
from service.rows import eta, jobs


def commit(
    submission: Submission,
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
    context, caller = submission.context, submission.caller
    row = make_row(submission, values, options, handling)
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
        earlier = replay(submission, row["request_hash"])
        if earlier is None:  # what made it fail is gone, or it did not fail over the key
            raise
        return earlier
    with contextlib.suppress(BaseError):  # what stays is removed as pieces without an upload
        for upload_id in taken.values():
            upload_pieces.delete(context.storage, upload_id)
    return Accepted(row["id"], replayed=False)


def make_row(
    submission: Submission, values: dict[str, Any], options: BaseModel, handling: Handling
) -> dict[str, Any]:
    """Make the row of a job; values: what the other arguments do not give of it."""
    asked = options.model_dump(mode="json", exclude_unset=True)
    return values | {
        "owner": submission.caller.owner,
        "trace_id": submission.trace_id,
        "idempotency_key": submission.idempotency_key,
        "options": asked,
        "likeness": eta.likeness(asked, values.get("stored_bytes", 0), values.get("capture")),
        "priority": handling.priority,
        "webhook": handling.webhook and handling.webhook.model_dump(),
        "span_id": tracing.span_id(),
    }

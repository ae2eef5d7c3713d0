"""Refuses requests for which there is no room, unless they made their job already."""

from __future__ import annotations

from service.api.accepted_job import Accepted
from service.api.idempotency import find_earlier, replay
from service.api.submission import Submission
from service.room import check_room


def refuse_when_full(submission: Submission) -> None:
    """Refuse a new job where there is no room for it, before its body is read.

    One whose idempotency key made a job already passes. Raises what check_room raises.
    """
    if find_earlier(submission) is None:
        _check_room(submission, 1)


def replay_or_admit(submission: Submission, request_hash: str, coming: int = 1) -> Accepted | None:
    """Give the job that a request has made already; see that there is room for that of a new one.

    coming: how many jobs that is. Raises IdempotencyError, and what check_room raises.
    """
    earlier = replay(submission, request_hash)
    if earlier is None:
        _check_room(submission, coming)
    return earlier


def _check_room(submission: Submission, coming: int) -> None:
    context, owner = submission.context, submission.caller.owner
    check_room(context.engine, context.settings, context.storage, owner, coming)

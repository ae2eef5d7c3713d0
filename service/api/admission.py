"""Refuses requests for which there is no room, unless they made their job already."""

from __future__ import annotations

from service.api.idempotency import find_earlier
from service.api.submission import Submission
from service.room import check_room


def refuse_when_full(submission: Submission, coming: int = 1) -> None:
    """Refuse new jobs where there is no room for them: before their body is read, and once it is.

    One whose idempotency key made a job already passes. coming: how many jobs. Raises what
    check_room raises.
    """
    if find_earlier(submission):
        return
    context, owner = submission.context, submission.caller.owner
    check_room(context.engine, context.settings, context.storage, owner, coming)

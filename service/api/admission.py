"""Refuses requests for which there is no room, unless they made their job already."""

from __future__ import annotations

from service.api.context import Context
from service.api.idempotency import find_earlier
from service.api.submission import Submission
from service.room import check_disk, check_room


def refuse_when_full(submission: Submission, coming: int = 1) -> None:
    """Refuse new jobs where there is no room for them: before their body is read, and once it is.

    One whose idempotency key made a job already passes. coming: how many jobs. Raises what
    check_room raises.
    """
    if find_earlier(submission):
        return
    context, owner = submission.context, submission.caller.owner
    check_room(context.engine, context.settings, context.storage, owner, coming)


def refuse_when_disk_full(context: Context) -> None:
    """Raise StorageFullError when the store's disk is nearly full."""
    check_disk(context.settings, context.storage)

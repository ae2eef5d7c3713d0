"""Makes the job that a request asks for, in a thread that only what it waits for can hold up."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from fastapi.concurrency import run_in_threadpool

from service.api.accept_pair import accept_pair
from service.api.accepted_job import Accepted
from service.api.captures import accept_capture
from service.api.context import Context
from service.api.intake import Intake
from service.api.submission import Submission


async def make_job(submission: Submission, wanted: Intake) -> Accepted:
    """Make a job of a pair that was sent, or of a capture.

    Raises what accept_pair and accept_capture raise.
    """
    if wanted.capture is None:
        return await submission.context.store(accept_pair, submission, wanted)
    work = partial(accept_capture, submission, wanted)
    return await queue_captures(submission.context, wanted.calibrations, work)


async def queue_captures(
    context: Context, named: dict[str, Any], work: Callable[[], Accepted]
) -> Accepted:
    """Accept captures in a thread that no store holds up, unless calibrations are read from it.

    named: calibrations, as an Intake has them. Raises what the work raises.
    """
    return await (context.fetch(work) if named else run_in_threadpool(work))

"""Makes the jobs that a request asks for, in a thread that only what it waits for can hold up."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from fastapi.concurrency import run_in_threadpool

from service.api.accept_pair import accept_pair
from service.api.accepted_job import Accepted
from service.api.captures import accept_capture, accept_captures
from service.api.context import Context
from service.api.intake import Intake
from service.api.models import CameraCapture
from service.api.submission import Submission


async def make_job(submission: Submission, wanted: Intake) -> Accepted:
    """Make a job of a pair that was sent, or of a capture.

    Raises what accept_pair and accept_capture raise.
    """
    if wanted.capture is None:
        return await submission.context.store(accept_pair, submission, wanted)
    accept = partial(accept_capture, submission, wanted)
    return await _accept(submission.context, accept, wanted.calibrations)


async def make_captures(
    submission: Submission, camera: str, wanted: CameraCapture, named: dict[str, Any]
) -> Accepted:
    """Make the jobs of a burst, as accept_captures does. Raises what that raises."""
    accept = partial(accept_captures, submission, camera, wanted, named)
    return await _accept(submission.context, accept, named)


async def _accept(
    context: Context, accept: Callable[[], Accepted], named: dict[str, Any]
) -> Accepted:
    """Accept captures in a thread that a store can hold up only if it has calibrations to give."""
    return await (context.fetch(accept) if named else run_in_threadpool(accept))

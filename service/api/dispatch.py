"""Makes jobs of what was read of requests, each in a thread of those for what it needs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from fastapi.concurrency import run_in_threadpool

from service.api.accept import Accepted, accept
from service.api.callers import Caller
from service.api.captures import accept_capture
from service.api.context import Context
from service.api.intake import Intake


async def make_job(
    context: Context,
    caller: Caller,
    wanted: Intake,
    idempotency_key: str | None,
    trace_id: str,
) -> Accepted:
    """Make a job of a pair that was sent, or of a capture. Raises what the two `accept` raise."""
    arguments = (context, caller, wanted, idempotency_key, trace_id)
    if wanted.capture is None:
        return await context.store(accept, *arguments)
    return await queue_captures(context, wanted.calibrations, accept_capture, *arguments)


async def queue_captures(
    context: Context, named: dict[str, Any], work: Callable[..., Accepted], *arguments: Any
) -> Accepted:
    """Accept captures in a thread that no store holds up, but where calibrations are read of it.

    named: calibrations, as an Intake has them. Raises what the work raises.
    """
    if named:
        return await context.fetch(work, *arguments)
    return await run_in_threadpool(work, *arguments)

"""Attempts at jobs, as a worker that goes on would make them."""

from __future__ import annotations

from typing import Any

from service.api.context import Context
from service.frames import FRAMES
from service.object_keys import describe_inputs, inputs_key
from service.rows import attempts, jobs
from service.settings import Settings
from service.workers.attempt import Attempt


def attempt_at(
    held: jobs.Job | None, context: Context, settings: Settings | None = None
) -> Attempt:
    """An attempt at a job that was claimed. settings: in place of those of the context."""
    assert held is not None
    return Attempt(
        held,
        context.engine,
        context.storage,
        settings or context.settings,
        context.fork_server,
        lambda: False,
    )


def attempt_once(context: Context) -> jobs.Job | None:
    """Make one attempt at a job of two photographs; the job afterwards, None when deleted."""
    for frame in FRAMES:
        context.storage.put(inputs_key("a", frame), frame.encode())
    values: dict[str, Any] = {
        "id": "a",
        "options": {},
        "inputs": describe_inputs("a", dict.fromkeys(FRAMES, "")),
        "trace_id": "1" * 32,
        "request_hash": "",
    }
    with context.engine.begin() as connection:
        jobs.add(connection, values)
        held = attempts.claim(connection, "a", "w")
    attempt_at(held, context).run()
    with context.engine.connect() as connection:
        return jobs.find(connection, "a")

"""Attempts at jobs, as a worker that goes on would make them."""

from __future__ import annotations

from service.api.context import Context
from service.frames import FRAMES
from service.object_keys import inputs_key
from service.rows import jobs
from service.settings import Settings
from service.workers.attempt import Attempt
from service.workers.means import Means
from tests.unit.service.job_rows import added_pair, claim


def attempt_at(
    held: jobs.Job | None, context: Context, settings: Settings | None = None
) -> Attempt:
    """An attempt at a job that was claimed. settings: in place of those of the context."""
    assert held is not None
    given = settings or context.settings
    means = Means.of(held, context.engine, context.storage, given, lambda: False)
    return Attempt(means, context.fork_server)


def attempt_once(context: Context) -> jobs.Job | None:
    """Make one attempt at a job of two photographs; the job afterwards, None when deleted."""
    for frame in FRAMES:
        context.storage.put(inputs_key("a", frame), frame.encode())
    added_pair(context.engine)
    held = claim(context.engine, "a", "w")
    attempt_at(held, context).run()
    with context.engine.connect() as connection:
        return jobs.find(connection, "a")

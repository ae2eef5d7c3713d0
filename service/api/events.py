"""The route of server-sent events: what happens to a job, as it happens."""

from __future__ import annotations

from collections.abc import AsyncIterator
from typing import Annotated

from fastapi import APIRouter, Header
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import Response
from fastapi.sse import KEEPALIVE_COMMENT, format_sse_event

from service import answers
from service.api.callers import Caller, Calling, Standing, find
from service.api.context import Context, Parts
from service.api.job_updates import (
    JobUpdates,
    Snapshot,
)
from service.api.problems import responses
from service.api.streams import KEEP_ALIVE_SECONDS, RETRY, stream_events
from service.errors import UnknownJobError

router = APIRouter(tags=["jobs"])


@router.get(
    "/jobs/{job_id}/events",
    response_class=Response,  # what FastAPI makes of the other class cannot answer 204
    responses={
        200: {
            "description": "The job as GET /jobs/{job_id} shows it, at once and after each change, "
            "to the last one when it has ended; the event `deleted` when it is deleted.",
            "content": {"text/event-stream": {"schema": {}}},
        },
        204: {"description": "The job has ended and Last-Event-ID names its last event."},
        **responses(UnknownJobError, status=(503,)),
    },
)
async def watch_job(
    context: Parts,
    caller: Calling,
    job_id: str,
    last_event_id: Annotated[
        str | None, Header(description="Id of the last event seen: only what came after is sent.")
    ] = None,
) -> Response:
    """Watch a job by server-sent events."""
    first = await run_in_threadpool(_look, context, caller, job_id)
    if first.ended and first.mark == last_event_id:
        return Response(status_code=204)  # which tells a browser not to come again
    standing = Standing(context.engine, caller)
    return stream_events(_events(context.job_updates, standing, job_id, last_event_id))


def _look(context: Context, caller: Caller, job_id: str) -> Snapshot:
    with context.engine.connect() as connection:
        job = find(connection, caller, job_id)
        (answer,) = answers.of_jobs(connection, context.settings, [job])
    return Snapshot(answer, job.revision, job.ended)


async def _events(
    job_updates: JobUpdates, standing: Standing, job_id: str, seen: str | None
) -> AsyncIterator[bytes]:
    yield RETRY
    with job_updates.watch(job_id) as watched:
        while not job_updates.closed and await standing.holds():
            latest = watched.latest
            if watched.gone:
                yield format_sse_event(event="deleted", data_str=f'{{"id": "{job_id}"}}')
                return
            if latest and latest.mark != seen:
                seen = latest.mark
                yield format_sse_event(data_str=latest.answer.model_dump_json(), id=seen)
                if latest.ended:
                    return
                continue  # more may have come while this was sent
            if not await watched.change(KEEP_ALIVE_SECONDS):
                yield KEEPALIVE_COMMENT

"""The answers of routes that tell of one job, or make one."""

from __future__ import annotations

from fastapi import Response
from fastapi.concurrency import run_in_threadpool

from service import answers
from service.answers import JobAnswer
from service.api.accepted_job import Accepted
from service.api.callers import Caller, find
from service.api.context import Context
from service.api.submission import Submission


def answer(context: Context, caller: Caller, job_id: str) -> JobAnswer:
    """Make the answer for a job. Raises UnknownJobError."""
    with context.engine.connect() as connection:
        job = find(connection, caller, job_id)
        (made,) = answers.of_jobs(connection, context.settings, [job])
    return made


async def answer_made(
    submission: Submission, made: Accepted, wait: int, response: Response
) -> JobAnswer:
    """Make the answer for a job just made, once it has ended or after so many seconds."""
    context = submission.context
    if wait:
        await context.job_updates.until_over(made.job_id, wait)
    response.headers.update(made.headers)
    return await run_in_threadpool(answer, context, submission.caller, made.job_id)

"""Who asks for jobs, of which service, and under which idempotency key."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Annotated

from fastapi import Depends, Header
from pydantic import AfterValidator, Field

from service.api.callers import Caller, Calling
from service.api.context import Context, Parts, TraceId

_KEY = "[!-~]{1,255}"


def _check_key(key: str) -> str:
    if not re.fullmatch(_KEY, key):
        raise ValueError("use 1 to 255 visible ASCII characters without spaces, such as a UUID")
    return key


IdempotencyKey = Annotated[
    Annotated[str, AfterValidator(_check_key), Field(json_schema_extra={"pattern": f"^{_KEY}$"})]
    | None,
    Header(
        description="Any text without spaces that no other request bears, such as a UUID: the same "
        "request sent again gives the same job, for as long as the job is kept.",
    ),
]


@dataclass(frozen=True)
class Submission:
    """What the making of a job needs to know of its request, the body apart."""

    context: Context
    caller: Caller
    idempotency_key: str | None
    trace_id: str


async def _submission(
    context: Parts, caller: Calling, trace_id: TraceId, idempotency_key: IdempotencyKey = None
) -> Submission:
    return Submission(context, caller, idempotency_key, trace_id)


Submitting = Annotated[Submission, Depends(_submission)]

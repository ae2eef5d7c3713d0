"""Route of areas: a part of the layers in full size, for who looks closely."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated

import numpy as np
from fastapi import APIRouter, Query
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import Response, StreamingResponse
from numpy.typing import NDArray

from pipeline.encode.exr_rows import ScanLines
from pipeline.errors import OptionError
from pipeline.result_names import LAYERS, layer_channels
from service.api.callers import Calling
from service.api.context import Parts
from service.api.find_results import find_result, find_succeeded
from service.api.problems import responses
from service.errors import GoneError, NotReadyError, UnknownJobError, UnknownResultError
from service.object_keys import results_key
from service.rows.availability import deleted_meanwhile
from service.rows.jobs import Job
from service.storage.base import Storage

router = APIRouter(tags=["results"])

MOST_PIXELS = 2**21
"""Most pixels of an area."""


@router.get(
    "/jobs/{job_id}/area",
    response_class=Response,
    responses={
        200: {
            "description": "16-bit floats, little-endian, row by row: red of lamp 1, all of it, "
            "then its green, its blue, red of lamp 2 and so on; the values of layers.exr.",
            "content": {
                "application/octet-stream": {"schema": {"type": "string", "format": "binary"}}
            },
        },
        **responses(
            UnknownJobError,
            UnknownResultError,
            NotReadyError,
            GoneError,
            OptionError,
            status=(422, 503),
        ),
    },
)
async def get_area(
    context: Parts,
    caller: Calling,
    job_id: str,
    left: Annotated[int, Query(ge=0, description="Pixels left of it.")],
    top: Annotated[int, Query(ge=0, description="Pixels above it.")],
    width: Annotated[int, Query(ge=1, description="Pixels.")],
    height: Annotated[int, Query(ge=1, description="Pixels; 2,097,152 in all at most.")],
) -> Response:
    """Get an area of the layers in full size."""
    job = await run_in_threadpool(find_succeeded, context, caller, job_id)
    planes = await context.fetch(_read, context.storage, job, left, top, width, height)

    def chunks() -> Iterator[bytes]:
        for plane in planes:
            yield plane.tobytes()

    headers = {"Content-Length": str(planes.nbytes)}
    return StreamingResponse(chunks(), headers=headers, media_type="application/octet-stream")


def _read(
    storage: Storage, job: Job, left: int, top: int, width: int, height: int
) -> NDArray[np.float16]:
    size = find_result(job, LAYERS)["size"]
    key = results_key(job.id, job.attempt, LAYERS)

    def read(start: int, end: int) -> bytes:
        return b"".join(storage.stream(key, start, min(end, size)))

    with deleted_meanwhile():
        lines = ScanLines(read)
    if left + width > lines.width or top + height > lines.height:
        raise OptionError(f"The picture has {lines.width} x {lines.height} pixels: ask within it.")
    if width * height > MOST_PIXELS:
        raise OptionError(f"An area has {MOST_PIXELS} pixels at most: ask for several.")
    lamps = sum(name.endswith(".R") for name in lines.channels)
    with deleted_meanwhile():
        return lines.area(layer_channels(lamps), left, top, width, height)

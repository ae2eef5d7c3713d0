"""Routes of results: the manifest, one file, all files."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Annotated, Any

from fastapi import APIRouter, Header, Request
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import RedirectResponse, Response, StreamingResponse
from pydantic import WithJsonSchema

from pipeline.result_names import MANIFEST
from service.api.callers import Calling
from service.api.context import Context, Parts
from service.api.find_results import find_result, find_succeeded
from service.api.prefer import preferences
from service.api.problems import responses
from service.api.ranges import parse_range
from service.api.zips import Member, stored_zip
from service.errors import GoneError, NotReadyError, RangeError, UnknownJobError, UnknownResultError
from service.media import headers_of
from service.object_keys import results_key
from service.rows import jobs
from service.rows.availability import deleted_meanwhile

router = APIRouter(tags=["results"])

LINK_SECONDS = 300
"""How long a URL of the store is good for."""

_BINARY = {"schema": {"type": "string", "format": "binary"}}


@router.head("/jobs/{job_id}/results", include_in_schema=False)
@router.get(
    "/jobs/{job_id}/results",
    response_class=Response,
    responses={
        200: {
            "description": "The manifest; docs/results.md says what each field means.",
            "content": {"application/json": {"schema": {"$ref": "#/components/schemas/Manifest"}}},
        },
        **responses(UnknownJobError, NotReadyError, GoneError, status=(503,)),
    },
)
async def get_manifest(context: Parts, caller: Calling, job_id: str) -> Response:
    """Get the manifest: inputs, options, lamps, files, warnings, versions."""
    job = await run_in_threadpool(find_succeeded, context, caller, job_id)
    find_result(job, MANIFEST)
    key = results_key(job_id, job.attempt, MANIFEST)
    with deleted_meanwhile():
        data = await context.fetch(context.storage.get, key)
    return Response(data, media_type="application/json")


@router.head("/jobs/{job_id}/results/{name}", include_in_schema=False)
@router.get(
    "/jobs/{job_id}/results/{name}",
    response_class=Response,
    responses={
        200: {"description": "The file.", "content": {"*/*": _BINARY}},
        206: {"description": "The part that Range asked for.", "content": {"*/*": _BINARY}},
        304: {"description": "The file is the one that If-None-Match names."},
        307: {"description": "Where the store itself gives the file, for some minutes."},
        **responses(
            UnknownJobError,
            UnknownResultError,
            NotReadyError,
            GoneError,
            RangeError,
            status=(503,),
        ),
    },
)
async def get_result(
    request: Request,
    context: Parts,
    caller: Calling,
    job_id: str,
    name: str,
    range: Annotated[str | None, Header()] = None,
    if_range: Annotated[str | None, Header()] = None,
    if_none_match: Annotated[str | None, Header()] = None,
    prefer: Annotated[
        list[str] | None,
        WithJsonSchema({"type": "string"}),
        Header(description="no-redirect: the file itself, also where the store could give it."),
    ] = None,
) -> Response:
    """Get one file of the results, whole or in part."""
    job = await run_in_threadpool(find_succeeded, context, caller, job_id)
    result = find_result(job, name)
    etag = f'"{result["sha256"]}"'
    headers = {
        "ETag": etag,
        "Accept-Ranges": "bytes",
        "Cache-Control": "private, no-cache",  # asked each time: the key may be gone, or the job
        "Content-Disposition": headers_of(name)["Content-Disposition"],
    }
    if if_none_match and (if_none_match.strip() == "*" or etag in if_none_match):
        return Response(status_code=304, headers=headers)
    if request.method == "HEAD":  # to which Range means nothing
        headers["Content-Length"] = str(result["size"])
        return Response(headers=headers, media_type=result["media_type"])
    key = results_key(job_id, job.attempt, name)
    if link := await _link(context, key, prefer or []):
        return RedirectResponse(link, headers={"Cache-Control": "no-store"})
    part = parse_range(range if if_range in (None, etag) else None, result["size"])
    return await _bytes(context, key, result, part, headers)


async def _link(context: Context, key: str, prefer: list[str]) -> str | None:
    """Give a URL of the store for a file, where it gives one and the caller wants it."""
    if not context.settings.store_presign or "no-redirect" in preferences(prefer):
        return None
    return await context.fetch(context.storage.link, key, LINK_SECONDS)


async def _bytes(
    context: Context,
    key: str,
    result: dict[str, Any],
    part: tuple[int, int] | None,
    headers: dict[str, str],
) -> Response:
    """Answer with the bytes of a file; part: first and one after the last, None for all of it."""
    start, end = part or (0, result["size"])
    headers["Content-Length"] = str(end - start)
    if part:
        headers["Content-Range"] = f"bytes {start}-{end - 1}/{result['size']}"
    with deleted_meanwhile():
        chunks = await context.fetch(context.storage.stream, key, start, end)
    return StreamingResponse(
        context.stream(_until_deleted(chunks)),
        206 if part else 200,
        headers=headers,
        media_type=result["media_type"],
    )


@router.head("/jobs/{job_id}/results.zip", include_in_schema=False)
@router.get(
    "/jobs/{job_id}/results.zip",
    response_class=Response,
    responses={
        200: {"description": "Every file, stored.", "content": {"application/zip": _BINARY}},
        **responses(UnknownJobError, NotReadyError, GoneError, status=(503,)),
    },
)
async def get_zip(request: Request, context: Parts, caller: Calling, job_id: str) -> Response:
    """Get all results in one ZIP file."""
    job = await run_in_threadpool(find_succeeded, context, caller, job_id)
    headers = {"Content-Disposition": f'attachment; filename="{job_id}.zip"'}
    chunks: Iterator[bytes] = iter(())
    if request.method != "HEAD":
        chunks = stored_zip([_member(context, job, result) for result in job.results or []])
        chunks = itertools.chain([await context.fetch(next, chunks)], chunks)
    return StreamingResponse(context.stream(chunks), headers=headers, media_type="application/zip")


def _member(context: Context, job: jobs.Job, result: dict[str, Any]) -> Member:
    key = results_key(job.id, job.attempt, result["name"])

    def chunks() -> Iterator[bytes]:
        with deleted_meanwhile():
            yield from context.storage.stream(key, 0, result["size"])

    return Member(result["name"], result["size"], chunks)


def _until_deleted(chunks: Iterator[bytes]) -> Iterator[bytes]:
    with deleted_meanwhile():
        yield from chunks

"""The page for people, and its files."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Annotated

from fastapi import APIRouter, Header, Response
from starlette.exceptions import HTTPException

router = APIRouter(include_in_schema=False)

_FOLDER = Path(__file__).parents[1] / "page"
_TYPES = {
    ".html": "text/html",
    ".css": "text/css",
    ".js": "text/javascript",
    ".svg": "image/svg+xml",
}
# read once: the page belongs to this process, under which an upgrade may replace the files
_FILES = {path.name: path.read_bytes() for path in _FOLDER.iterdir() if path.suffix in _TYPES}
# of what is in them: files of two images may well have the same size and time
_ETAGS = {name: f'"{hashlib.sha256(data).hexdigest()}"' for name, data in _FILES.items()}
# blob: pictures that were fetched with headers, which no <img> could send
_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
_HEADERS = {"Content-Security-Policy": _POLICY, "Cache-Control": "no-cache"}
"""In place of those that every answer has, see service.api.headers."""
_Known = Annotated[str | None, Header(alias="If-None-Match")]


@router.head("/")
@router.get("/")
def get_page(known: _Known = None) -> Response:
    """Get the page."""
    return _answer("index.html", known)


@router.head("/page/{name}")
@router.get("/page/{name}")
def get_page_file(name: str, known: _Known = None) -> Response:
    """Get a file of the page."""
    if name not in _FILES:
        raise HTTPException(404, "Not Found")
    return _answer(name, known)


def _answer(name: str, known: str | None) -> Response:
    headers = {**_HEADERS, "ETag": _ETAGS[name]}
    if known and _ETAGS[name] in known:
        return Response(status_code=304, headers=headers)
    return Response(_FILES[name], media_type=_TYPES[Path(name).suffix], headers=headers)

"""The OpenAPI document, and a page that shows it."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter, Request
from fastapi.openapi.docs import get_swagger_ui_html
from fastapi.responses import HTMLResponse

router = APIRouter(include_in_schema=False)

_SCRIPTS = "https://cdn.jsdelivr.net"
_POLICY = (
    f"default-src 'none'; script-src {_SCRIPTS} 'unsafe-inline'; style-src {_SCRIPTS} "
    "'unsafe-inline'; img-src data:; connect-src 'self'; frame-ancestors 'none'"
)


@router.get("/openapi.json")
def get_document(request: Request) -> dict[str, Any]:
    """Get the OpenAPI document."""
    document: dict[str, Any] = request.app.openapi()
    return document


@router.get("/docs")
def get_page(request: Request) -> HTMLResponse:
    """Get the page; its script comes from elsewhere."""
    page = get_swagger_ui_html(
        openapi_url="/openapi.json", title=request.app.title, swagger_favicon_url="data:,"
    )
    page.headers["Content-Security-Policy"] = _POLICY
    return page

"""Asks for uploads as https://tus.io/protocols/resumable-upload has them."""

from __future__ import annotations

import httpx

TUS = {"Tus-Resumable": "1.0.0"}
PIECE = {**TUS, "Content-Type": "application/offset+octet-stream"}


def create(http: httpx.Client, length: int, **headers: str) -> str:
    """Begin an upload; its path."""
    answer = http.post("/uploads", headers={**TUS, "Upload-Length": str(length), **headers})
    assert answer.status_code == 201, answer.text
    return answer.headers["location"]


def patch(
    http: httpx.Client, place: str, offset: int, data: bytes, **headers: str
) -> httpx.Response:
    return http.patch(
        place, content=data, headers={**PIECE, "Upload-Offset": str(offset), **headers}
    )


def offset_of(http: httpx.Client, place: str) -> int:
    answer = http.head(place, headers=TUS)
    assert answer.status_code == 200
    return int(answer.headers["upload-offset"])


def upload(http: httpx.Client, data: bytes) -> str:
    """Upload a whole photograph; its id."""
    place = create(http, len(data))
    assert patch(http, place, 0, data).status_code == 204
    return place.rpartition("/")[2]

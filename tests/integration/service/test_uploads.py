"""Uploads to a real service: by a client of tus that others wrote, and in the formats of phones."""

from __future__ import annotations

import io
import socket
from pathlib import Path
from typing import Any

import pytest
from tusclient.client import TusClient

import drivers
from service.storage.by_url import storage_at
from tests.hostile.photographs import pairs


@pytest.fixture
def files(pair: drivers.CapturedPair) -> dict[str, bytes]:
    return {"no_flash": pair.no_flash.best, "flash": pair.flash.best}


def _id(uploader: Any) -> str:
    return str(uploader.url).rpartition("/")[2]


def _job_of(service: Any, ids: dict[str, str]) -> Any:
    answer = service.http.post("/jobs", json={"uploads": ids, "options": {"lights": 2}})
    assert answer.status_code == 202, answer.text
    return service.await_end(answer.json())


def test_tuspy_uploads_a_pair_that_becomes_a_job(service: Any, files: dict[str, bytes]) -> None:
    client = TusClient(f"{service.url}/uploads")
    ids = {}
    for frame, data in files.items():
        metadata = {"filename": "holiday.dng"}
        uploader = client.uploader(
            file_stream=io.BytesIO(data), chunk_size=50_000, upload_checksum=True, metadata=metadata
        )
        uploader.upload()
        ids[frame] = _id(uploader)
    done = _job_of(service, ids)
    assert (done["state"], done["error"]) == ("succeeded", None)
    left = storage_at((service.data / "store").as_uri()).list("uploads/")
    assert [name for name in left if name.split("/")[1] in ids.values()] == []
    assert "holiday" not in service.log.read_text()


def test_tuspy_goes_on_where_service_and_connection_broke(
    breakable: Any, files: dict[str, bytes]
) -> None:
    client = TusClient(f"{breakable.url}/uploads")
    begun: dict[str, Any] = {}
    for frame, data in files.items():
        uploader = client.uploader(file_stream=io.BytesIO(data), chunk_size=30_000)
        uploader.upload(stop_at=30_000)
        _break_off(breakable, _id(uploader), data)
        begun[frame] = uploader.url
    breakable.kill()
    breakable.start()
    ids = {}
    for frame, data in files.items():
        resumed = client.uploader(file_stream=io.BytesIO(data), url=begun[frame])
        assert resumed.offset == 50_000
        resumed.upload()
        ids[frame] = _id(resumed)
    assert _job_of(breakable, ids)["state"] == "succeeded"


def _break_off(service: Any, upload_id: str, data: bytes) -> None:
    """Send 20 000 bytes of the rest, and hang up; wait until the service has kept them."""
    path = f"/uploads/{upload_id}"
    head = f"PATCH {path} HTTP/1.1\r\nHost: localhost\r\nTus-Resumable: 1.0.0\r\n"
    head += f"Upload-Offset: 30000\r\nContent-Length: {len(data) - 30_000}\r\n"
    head += "Content-Type: application/offset+octet-stream\r\n\r\n"
    parts = service.data / "work"

    def arrived() -> bool:
        sizes = [path.stat().st_size for path in parts.glob("*/part")]
        return sizes == [20_000]

    with socket.create_connection(("127.0.0.1", service.port)) as connection:
        connection.sendall(head.encode() + data[30_000:50_000])
        service.await_that("the piece is there", arrived)
    told = {"Tus-Resumable": "1.0.0"}
    service.await_that(
        "it is kept",
        lambda: service.http.head(path, headers=told).headers["upload-offset"] == "50000",
    )


@pytest.mark.parametrize("media_type", ["", "application/octet-stream", None])
def test_a_heic_pair_of_any_type_is_separated(service: Any, media_type: str | None) -> None:
    before, after = pairs()["heic"]
    kind = "" if media_type is None else f"Content-Type: {media_type}\r\n"
    options = b'{"lights": 2, "outputs": ["layers.exr"]}'
    body = b'--edge\r\nContent-Disposition: form-data; name="options"\r\n\r\n' + options + b"\r\n"
    for frame, data in (("no_flash", before), ("flash", after)):
        head = f'Content-Disposition: form-data; name="{frame}"; filename="IMG_1"\r\n{kind}\r\n'
        body += b"--edge\r\n" + head.encode() + data + b"\r\n"
    headers = {"content-type": "multipart/form-data; boundary=edge", "prefer": "wait=60"}
    answer = service.http.post(
        "/jobs", content=body + b"--edge--\r\n", headers=headers, timeout=180
    )
    done = service.await_end(answer.json())
    assert (done["state"], done["error"]) == ("succeeded", None)


def test_expired_uploads_and_pieces_without_an_upload_go_at_the_start(breakable: Any) -> None:
    told = {"Tus-Resumable": "1.0.0", "Content-Type": "application/offset+octet-stream"}
    made = breakable.http.post("/uploads", headers={**told, "Upload-Length": "6"}, content=b"abc")
    storage = storage_at((breakable.data / "store").as_uri())
    (kept,) = storage.list("uploads/")
    storage.put("uploads/nobodys/0-0", b"abc")
    left: Path = breakable.data / "work" / "left"
    left.mkdir(parents=True)
    assert breakable.stop() == 0
    breakable.start()
    assert storage.list("uploads/") == [kept]
    assert not left.exists()
    place = made.headers["location"]
    assert breakable.http.head(place, headers=told).headers["upload-offset"] == "3"

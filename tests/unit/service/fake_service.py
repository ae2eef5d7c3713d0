"""A service for what sends to one."""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Mapping
from typing import Any, BinaryIO

from service.sending.client import Client, Job


class FakeService(Client):
    """A service in this process that takes every pair. fails: errors of the next requests."""

    def __init__(self) -> None:
        super().__init__("http://127.0.0.1:9")
        self.uploads: dict[str, bytes] = {}
        self.jobs: dict[str, Job] = {}
        self.tries = threading.Semaphore(0)
        self.error: Exception | None = None

    def create_upload(self, size: int) -> str:
        assert size
        self.tries.release()
        if self.error:
            raise self.error
        self.uploads[f"{len(self.uploads)}"] = b""
        return f"{len(self.uploads) - 1}"

    def upload_offset(self, upload_id: str) -> int | None:
        return len(self.uploads[upload_id]) if upload_id in self.uploads else None

    def append_to_upload(self, upload_id: str, file: BinaryIO, offset: int, size: int) -> None:
        file.seek(offset)
        self.uploads[upload_id] += file.read()
        assert len(self.uploads[upload_id]) == size

    def submit_uploads(
        self, uploads: Mapping[str, str], options: Mapping[str, Any], idempotency_key: str
    ) -> Job:
        assert options == {}
        digests = {
            frame: {"sha256": hashlib.sha256(self.uploads[each]).hexdigest()}
            for frame, each in uploads.items()
        }
        job = {"id": f"job{len(self.jobs)}", "inputs": digests}
        return self.jobs.setdefault(idempotency_key, job)

    @property
    def stored(self) -> list[dict[str, str]]:
        return [
            {frame: file["sha256"] for frame, file in job["inputs"].items()}
            for job in self.jobs.values()
        ]

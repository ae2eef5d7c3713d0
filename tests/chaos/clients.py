"""Patient clients: each asks again, with the same Idempotency-Key, until it is answered."""

from __future__ import annotations

import contextlib
import hashlib
import json
import socket
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import urlsplit

import httpx

import drivers
from tests.chaos.plan import Wish

CAMERA = "sim://studio?lights=2&width=96&height=64"
ENDED = ("succeeded", "failed", "canceled", "expired")
_TIMEOUT_SECONDS = 15.0
_PATIENCE_SECONDS = 400.0
_LOOK_SECONDS = 0.5

Pair = dict[str, bytes]
Job = dict[str, Any]


@dataclass
class Accepted:
    """A job that the service has answered for with 202."""

    wish: Wish
    key: str
    deleted: bool = False  # and that was answered for, too
    end: Job | None = None  # the end that the client was told of


@dataclass
class Ledger:
    """What clients were told, by job id."""

    jobs: dict[str, Accepted] = field(default_factory=dict)
    doubled: list[str] = field(default_factory=list)
    impatient: list[str] = field(default_factory=list)
    lock: threading.Lock = field(default_factory=threading.Lock)


class GaveUpError(Exception):
    """Nobody answered for far too long."""


def pairs() -> list[Pair]:
    """Take three pairs that differ."""
    found = []
    for number in range(3):
        with drivers.open_camera(f"{CAMERA}&seed={number}") as camera:
            pair = drivers.capture_pair(camera)
        found.append({"no_flash": pair.no_flash.best, "flash": pair.flash.best})
    return found


class Clients:
    """Does wishes on the APIs of a service, and keeps the ledger."""

    def __init__(
        self, urls: list[str], found: list[Pair], ledger: Ledger, name: str, options: dict[str, int]
    ) -> None:
        """name: makes the keys of this run its own; options: of every job."""
        self._urls = urls
        self._pairs = found
        self._ledger = ledger
        self._name = name
        self._options = options
        self._http = httpx.Client(timeout=_TIMEOUT_SECONDS)

    def close(self) -> None:
        """Drop the connections."""
        self._http.close()

    def do(self, wish: Wish) -> None:
        """Have a job made, and see it through to its end."""
        key = f"{self._name}-{wish.number}"
        try:
            if wish.cut_at is not None and wish.pair is not None:
                self._cut_upload(wish, key, wish.cut_at)
            job_id = self._submit(wish, key)
            self._follow(job_id, wish)
        except GaveUpError as error:
            with self._ledger.lock:
                self._ledger.impatient.append(f"{key}: {error}")

    def _submit(self, wish: Wish, key: str) -> str:
        with ThreadPoolExecutor(1 + wish.repeats) as pool:
            sent = [pool.submit(self._send, wish, key, n) for n in range(1 + wish.repeats)]
            ids = {one.result() for one in sent}
        with self._ledger.lock:
            if len(ids) > 1:
                self._ledger.doubled.append(f"{key}: {len(ids)} jobs for one key")
            for job_id in ids:
                self._ledger.jobs[job_id] = Accepted(wish, key)
        return ids.pop()

    def _send(self, wish: Wish, key: str, first: int) -> str:
        headers = {"idempotency-key": key}
        if wish.pair is None:
            wanted = {"capture": {"camera": CAMERA}, "options": self._options}
            body: dict[str, Any] = {"json": wanted}
        else:
            data = {"options": json.dumps(self._options)}
            body = {"files": self._pairs[wish.pair], "data": data}
        answer = self.ask("POST", "/jobs", first, headers=headers, **body)
        if answer.status_code != 202:
            raise GaveUpError(f"status {answer.status_code}: {answer.text[:300]}")
        job_id: str = answer.json()["id"]
        return job_id

    def _follow(self, job_id: str, wish: Wish) -> None:
        here = f"/jobs/{job_id}"
        if wish.then != "wait":
            time.sleep(wish.delay)
        if wish.then == "cancel":
            self.ask("POST", f"{here}/cancel", wish.number)
        if wish.then == "delete":
            self.ask("DELETE", here, wish.number)
            self._ledger.jobs[job_id].deleted = True
            return
        deadline = time.monotonic() + _PATIENCE_SECONDS
        while time.monotonic() < deadline:
            answer = self.ask("GET", here, wish.number)
            if answer.status_code == 200 and answer.json()["state"] in ENDED:
                self._ledger.jobs[job_id].end = answer.json()
                return
            if answer.status_code != 200:
                return  # it is counted as lost in the end
            time.sleep(_LOOK_SECONDS)

    def ask(self, method: str, path: str, first: int = 0, **arguments: Any) -> httpx.Response:
        """Ask the APIs by turns until one answers with more than "later". Raises GaveUpError."""
        deadline = time.monotonic() + _PATIENCE_SECONDS
        why = ""
        turn = first
        while time.monotonic() < deadline:
            try:
                url = self._urls[turn % len(self._urls)]
                answer = self._http.request(method, url + path, **arguments)
                if answer.status_code < 500 and answer.status_code != 429:
                    return answer
                why = answer.text[:300]
            except httpx.HTTPError as error:
                why = repr(error)
            turn += 1
            time.sleep(_LOOK_SECONDS)
        raise GaveUpError(f"{method} {path}: {why}")

    def _cut_upload(self, wish: Wish, key: str, share: float) -> None:
        """Begin to upload, and close the connection in mid-body."""
        assert wish.pair is not None
        url = urlsplit(self._urls[wish.number % len(self._urls)])
        headers = {"idempotency-key": key}
        request = self._http.build_request(
            "POST",
            url.geturl() + "/jobs",
            files=self._pairs[wish.pair],
            data={"options": json.dumps(self._options)},
            headers=headers,
        )
        body = request.read()
        head = "".join(f"{name}: {value}\r\n" for name, value in request.headers.items())
        with (
            contextlib.suppress(OSError),
            socket.create_connection((url.hostname, url.port), timeout=5) as connection,
        ):
            connection.sendall(f"POST /jobs HTTP/1.1\r\n{head}\r\n".encode())
            connection.sendall(body[: int(len(body) * share)])

    def wrong_results(self, job_id: str) -> str | None:
        """Fetch all results of a job that has succeeded: what is wrong with them."""
        job = self.ask("GET", f"/jobs/{job_id}").json()
        digests = {}
        for file in job["files"]:
            answer = self.ask("GET", file["href"])
            digest = hashlib.sha256(answer.content).hexdigest()
            if answer.status_code != 200 or digest != file["sha256"]:
                return f"{file['name']}: status {answer.status_code}, SHA-256 {digest}"
            digests[file["name"]] = digest
        if "manifest.json" not in digests:
            return "no manifest"
        manifest = json.loads(self.ask("GET", f"/jobs/{job_id}/results").content)
        listed = {file["name"]: file["sha256"] for file in manifest["files"]}
        digests.pop("manifest.json")
        return None if listed == digests else "files and manifest differ"

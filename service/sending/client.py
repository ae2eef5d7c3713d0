"""Talks to a running service: what `lightlayers submit` and the demo use."""

from __future__ import annotations

import contextlib
import math
import re
import time
import uuid
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, Self, TypeVar

import httpx

from pipeline.errors import OptionError
from pipeline.options import Options
from service.rows.states import ENDED
from service.sending.failures import (
    RefusedError,
    ServiceAwayError,
    failure_of,
    failure_of_job,
    json_object,
    stranger,
)

_POLL_SECONDS = 0.3
_TIMEOUT_SECONDS = 60.0  # without a byte
_PATIENCE_SECONDS = 300.0  # with a service that is away, as while it starts anew
_FIRST_PAUSE_SECONDS = 1.0
_LONGEST_PAUSE_SECONDS = 15.0
_PIECE_BYTES = 1 << 16
_TUS = {"Tus-Resumable": "1.0.0"}
_GONE = (404, 410)

_LOOKED_AT = {"state", "stage", "fraction", "error", "files"}

Job = dict[str, Any]
Result = TypeVar("Result")


class Client:
    """A running service. Every method raises ServiceAwayError or RefusedError."""

    def __init__(self, url: str, key: str | None = None) -> None:
        """Talk to the service at a URL, like http://127.0.0.1:8000. Raises OptionError.

        key: sent with every request. A user and password in the URL go to a proxy before it.
        """
        if not _is_address(url):
            raise OptionError(
                f"{url[:80]!r} is no address of a service: write one like http://127.0.0.1:8000."
            )
        place = httpx.URL(url)
        if key and place.userinfo:  # both are the header Authorization
            raise OptionError(
                "A user and password in the address of the service take the place of the key, "
                "which would not be sent: leave one of them out."
            )
        self._place = str(place.copy_with(userinfo=b""))  # what is told gets into logs
        self._http = httpx.Client(
            base_url=url,
            headers={"Authorization": f"Bearer {key}"} if key else {},
            timeout=_TIMEOUT_SECONDS,
            follow_redirects=True,  # results may lie elsewhere
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._http.close()

    def check_ready(self) -> None:
        """Ask whether the service can take jobs."""
        self._json("GET", "/readyz")

    def submit_pair(self, no_flash: bytes, flash: bytes, options: Options) -> Job:
        """Send two photographs, for some minutes again while the service is away or busy."""
        self._json("GET", "/healthz")  # a wrong address is told at once
        return _patiently(
            partial(
                self._job,
                "POST",
                "/jobs",
                files={"no_flash": ("no_flash", no_flash), "flash": ("flash", flash)},
                # a default that was typed is none: what is kept for a set-up gives way to it
                data={"options": options.model_dump_json(exclude_unset=True)},
                headers={"Idempotency-Key": uuid.uuid4().hex},
            )
        )

    def submit_capture(self, camera: str, options: Options) -> Job:
        """Have the camera at an address take the pair; the job."""
        wanted = options.model_dump(mode="json", exclude_unset=True)
        return self._job("POST", "/jobs", json={"capture": {"camera": camera}, "options": wanted})

    def create_upload(self, size: int) -> str:
        """Begin to send a file of so many bytes piece by piece; the id of the upload."""
        headers = {**_TUS, "Upload-Length": str(size)}
        with self._request("POST", "/uploads", headers=headers) as response:
            upload_id = response.headers.get("location", "").rpartition("/")[2]
        if not re.fullmatch(r"[\w-]+", upload_id):
            raise stranger(response)
        return str(upload_id)

    def upload_offset(self, upload_id: str) -> int | None:
        """Ask at which byte an upload goes on; None where it is gone, into a job or for good."""
        try:
            with self._request("HEAD", f"/uploads/{upload_id}", headers=_TUS) as response:
                return int(response.headers["upload-offset"])
        except (RefusedError, ServiceAwayError) as error:
            if error.status in _GONE:
                return None
            raise
        except (KeyError, ValueError) as error:
            raise stranger(response) from error

    def append_to_upload(self, upload_id: str, file: BinaryIO, offset: int, size: int) -> None:
        """Send a file from a byte to its end, size; what has come stays where this breaks off."""
        file.seek(offset)
        headers = {
            **_TUS,
            "Upload-Offset": str(offset),
            "Content-Type": "application/offset+octet-stream",
            "Content-Length": str(size - offset),
        }
        pieces = iter(partial(file.read, _PIECE_BYTES), b"")
        # a body that is read once cannot be sent on to elsewhere
        arguments = {"headers": headers, "content": pieces, "follow_redirects": False}
        with self._request("PATCH", f"/uploads/{upload_id}", **arguments) as response:
            if response.status_code != 204:
                raise stranger(response)

    def submit_uploads(
        self, uploads: Mapping[str, str], options: Mapping[str, Any], idempotency_key: str
    ) -> Job:
        """Make a job of finished uploads, by frame; the same key gives the same job again."""
        body = {"uploads": dict(uploads), "options": dict(options)}
        headers = {"Idempotency-Key": idempotency_key}
        with self._request("POST", "/jobs", json=body, headers=headers) as response:
            response.read()
            try:
                job: Job = response.json()
                if (
                    response.status_code == 202
                    and job["id"]
                    and all(job["inputs"][frame]["sha256"] for frame in uploads)
                ):
                    return job
            except (ValueError, KeyError, TypeError):
                pass
            raise stranger(response)

    def wait(self, job: Job, report: Callable[[str, float], None]) -> Job:
        """Wait until a job has succeeded, telling how far it is; the job as it is then.

        It outlasts some minutes in which the service is away.
        """
        while job["state"] not in ENDED:
            if job["stage"]:
                report(job["stage"], job["fraction"])
            time.sleep(_POLL_SECONDS)
            job = _patiently(partial(self._job, "GET", job["links"]["self"]))
        if job["state"] == "canceled":
            raise RefusedError(
                "The job was canceled, from elsewhere: send the pair again if it is still wanted."
            )
        if job["error"]:
            raise failure_of_job(job["error"])
        if job["state"] == "expired":
            raise RefusedError("The job is expired: its results are being removed; send it again.")
        return job

    def download(self, job: Job, folder: Path) -> None:
        """Write every result of a job into a folder; a file has its name once it is whole.

        One that breaks off is fetched again, as often as some minutes of patience allow. Raises
        OSError where the folder cannot be written.
        """
        for file in job["files"]:
            _patiently(partial(self._fetch, file["href"], folder, Path(file["name"]).name))

    def _fetch(self, path: str, folder: Path, name: str) -> None:
        part = folder / f".partial-{name}"
        try:
            with self._request("GET", path) as response, part.open("wb") as target:
                for chunk in response.iter_bytes():
                    target.write(chunk)
            part.replace(folder / name)
        finally:
            part.unlink(missing_ok=True)

    def _job(self, method: str, path: str, **arguments: Any) -> Job:
        with self._request(method, path, **arguments) as response:
            job = json_object(response)
            links = job.get("links")
            if not (job.keys() >= _LOOKED_AT and isinstance(links, dict) and "self" in links):
                raise stranger(response)
            return job

    def _json(self, method: str, path: str) -> dict[str, Any]:
        with self._request(method, path) as response:
            return json_object(response)

    @contextlib.contextmanager
    def _request(self, method: str, path: str, **arguments: Any) -> Iterator[httpx.Response]:
        try:
            with self._http.stream(method, path, **arguments) as response:
                if response.request.method != method:  # as 301 makes a GET of a POST
                    raise self._moved(response, path)
                if response.is_error:
                    raise failure_of(response)
                yield response
        except (httpx.HTTPError, UnicodeError) as error:  # the latter: sent on to no host's name
            if "CERTIFICATE_VERIFY_FAILED" in str(error):
                raise ServiceAwayError(
                    f"The certificate of the service at {self._place} is none that this computer "
                    "trusts for it: check the address and this computer's clock, or have it "
                    "trusted (SSL_CERT_FILE)."
                ) from error
            raise ServiceAwayError(
                f"The service at {self._place} does not answer: start it, or check its address.",
                passes=True,
            ) from error

    def _moved(self, response: httpx.Response, path: str) -> ServiceAwayError:
        there = str(response.url.copy_with(userinfo=b"", query=None)).removesuffix(path)
        return ServiceAwayError(
            f"The service at {self._place} sends requests on to {there}: give that address, if it "
            "is the service's."
        )


def _is_address(url: str) -> bool:
    try:
        httpx.URL(url).raw_host.decode().encode("idna")  # as sockets do, when it is too late
    except (httpx.InvalidURL, UnicodeError):
        return False
    return bool(re.fullmatch(r"https?://[^\s/]+\S*", url))


def _patiently(ask: Callable[[], Result]) -> Result:
    deadline, pause = math.inf, _FIRST_PAUSE_SECONDS
    while True:
        try:
            return ask()
        except ServiceAwayError as error:
            # from the first failure on: what broke off may have gone well for longer than that
            deadline = min(deadline, time.monotonic() + _PATIENCE_SECONDS)
            wait = max(pause, error.retry_seconds)
            if not error.passes or time.monotonic() + wait > deadline:
                raise
        time.sleep(wait)
        pause = min(2 * pause, _LONGEST_PAUSE_SECONDS)

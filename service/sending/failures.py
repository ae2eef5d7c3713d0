"""What it means where a service does not do what was asked: whether to try again, what people read.

What answers may be another program, like a proxy before the service, which is told apart.
"""

from __future__ import annotations

from typing import Any

import httpx

from service.retry_after import retry_after

_ABOUT_WHAT_WAS_SENT = (400, 413, 415, 422)  # not about the key, the address or the moment


class ServiceAwayError(Exception):
    """The service does not answer, is too busy, or failed through no fault of the request.

    status: of HTTP, None where nothing answered or a job failed. passes: whether the same request
    may do better in a while; retry_seconds: in how long, as far as the service says so.
    """

    def __init__(
        self,
        message: str,
        status: int | None = None,
        passes: bool = False,
        retry_seconds: float = 0.0,
    ) -> None:
        super().__init__(message)
        self.status = status
        self.passes = passes
        self.retry_seconds = retry_seconds


class RefusedError(Exception):
    """The service refused the request for good, or the job failed for what was sent.

    status: of HTTP, None where a job failed. final: whether what was sent will never pass, with
    whichever key and whenever it is sent again.
    """

    def __init__(self, message: str, status: int | None = None, final: bool = False) -> None:
        super().__init__(message)
        self.status = status
        self.final = final


def failure_of(response: httpx.Response) -> ServiceAwayError | RefusedError:
    """Make the error that an answer of status 400 or more is."""
    problem, status = _problem(response), response.status_code
    if _is_away(problem):
        seconds = retry_after(response.headers.get("retry-after", ""))
        return ServiceAwayError(problem["detail"], status, _passes(problem), seconds)
    ours = str(problem.get("type")).startswith("urn:lightlayers:problem:")
    return RefusedError(problem["detail"], status, ours and status in _ABOUT_WHAT_WAS_SENT)


def failure_of_job(problem: dict[str, Any]) -> ServiceAwayError | RefusedError:
    """Make the error that the problem of a job is, which failed with it."""
    if _is_away(problem):
        return ServiceAwayError(problem["detail"], passes=_passes(problem))
    return RefusedError(problem["detail"])


def json_object(response: httpx.Response) -> dict[str, Any]:
    """Read the JSON object of an answer. Raises ServiceAwayError where it has none."""
    response.read()
    try:
        found = response.json()
    except ValueError as error:
        raise stranger(response) from error
    if not isinstance(found, dict):
        raise stranger(response)
    return found


def stranger(response: httpx.Response) -> ServiceAwayError:
    """Make the error of an answer that is none of a lightlayers service."""
    if response.status_code == 413:
        return ServiceAwayError(
            "A proxy before the service takes no request as large as this one (status 413): raise "
            "its limit, like client_max_body_size of nginx, to LIGHTLAYERS_UPLOAD_BYTES."
        )
    return ServiceAwayError(
        f"What answers is no lightlayers service (status {response.status_code}): check the "
        "address of the service."
    )


def _is_away(problem: dict[str, Any]) -> bool:
    return _passes(problem) or problem["status"] >= 500


def _passes(problem: dict[str, Any]) -> bool:
    return problem.get("retryable") is True


def _problem(response: httpx.Response) -> dict[str, Any]:
    if response.request.method == "HEAD" and "trace-id" in response.headers:
        return _told_by_status(response.status_code)
    try:
        problem = json_object(response)
    except ServiceAwayError:
        problem = {}
    if isinstance(problem.get("status"), int) and "detail" in problem:
        return problem
    # A proxy answers for a service that starts anew.
    passes = response.status_code >= 500
    return {"status": 500, "detail": str(stranger(response)), "retryable": passes}


def _told_by_status(status: int) -> dict[str, Any]:
    """The problem of an answer to HEAD of a lightlayers service: such answers have no body."""
    if status == 401:
        detail = "The service needs a key that is good: this one is missing, mistyped or revoked."
    elif status == 403:
        detail = "This key may not send photographs; use one that has the scope submit."
    elif status >= 500:
        detail = f"The service cannot answer now (status {status}); try again later."
    else:
        detail = f"The service does not tell how far the upload is (status {status})."
    return {"status": status, "detail": detail, "retryable": status == 503}

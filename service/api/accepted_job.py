"""The answer of routes that make a job: what it says, and how the OpenAPI document tells it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pipeline.errors import OptionError
from service.api.problems import responses
from service.errors import (
    IdempotencyError,
    MalformedRequestError,
    NotReadyError,
    QueueFullError,
    QuotaError,
    SlowRequestError,
    StorageFullError,
    StoredQuotaError,
    UnsupportedMediaError,
    UploadTooLargeError,
)

_TEXT = {"schema": {"type": "string"}}
_REPLAYED = {
    "description": "true: an earlier request with this Idempotency-Key made the job.",
    **_TEXT,
}


@dataclass(frozen=True)
class Accepted:
    """The job of a request; replayed when an earlier request with its key made it."""

    job_id: str
    replayed: bool

    @property
    def headers(self) -> dict[str, str]:
        """Headers of the 202."""
        location = {"Location": f"/jobs/{self.job_id}"}
        return location | ({"Idempotency-Replayed": "true"} if self.replayed else {})


def accepted(
    *errors: type[Exception], headers: dict[str, Any] | None = None
) -> dict[int | str, Any]:
    """Describe the answers of a route that makes a job.

    errors: its own problems. headers: its own headers.
    """
    usual = {"Location": _TEXT, "Idempotency-Replayed": _REPLAYED}
    return {
        202: {"headers": usual | (headers or {})},
        **responses(
            MalformedRequestError,
            UploadTooLargeError,
            UnsupportedMediaError,
            NotReadyError,  # a calibration that the options name
            OptionError,
            IdempotencyError,
            QueueFullError,
            QuotaError,
            SlowRequestError,
            StoredQuotaError,
            StorageFullError,
            *errors,
            status=(503,),
        ),
    }

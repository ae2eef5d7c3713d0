"""Errors as people and programs see them: RFC 9457 problems, and the table that makes them."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

from obstore import exceptions as obstore_errors
from pydantic import BaseModel, Field
from sqlalchemy.exc import DataError, DBAPIError
from sqlalchemy.exc import TimeoutError as NoConnectionError

import drivers
from pipeline import errors as pipeline_errors
from service.errors import (
    AbandonedError,
    BusyError,
    CameraHeldError,
    ChecksumError,
    CrashError,
    DeadlineError,
    EndedError,
    ExpiredUploadError,
    FileLimitError,
    ForbiddenError,
    ForeignCameraError,
    ForeignHostError,
    ForeignOriginError,
    GoneError,
    IdempotencyError,
    LayersGoneError,
    MalformedRequestError,
    MemoryLimitError,
    NoProcessError,
    NotReadyError,
    OffsetError,
    OlderWorkerError,
    OutputLimitError,
    QueueFullError,
    QuotaError,
    RangeError,
    SlowRequestError,
    StorageFullError,
    StoredQuotaError,
    TimeLimitError,
    TusVersionError,
    UnauthorizedError,
    UnfinishedUploadError,
    UnknownCameraError,
    UnknownJobError,
    UnknownResultError,
    UnknownUploadError,
    UnreadyError,
    UnsupportedMediaError,
    UploadTooLargeError,
)
from service.rows.database import is_full


class Problem(BaseModel):
    """What went wrong (RFC 9457)."""

    type: str = Field(description="Stable name of the kind of problem.")
    title: str = Field(description="The kind of problem in words.")
    status: int = Field(description="HTTP status code.")
    detail: str = Field(description="One sentence: what, where, and what to do.")
    retryable: bool = Field(description="Whether the same request may succeed later.")
    trace_id: str = Field(description="Names this request in the service's log.")


@dataclass(frozen=True)
class Kind:
    """A kind of problem. detail: the sentence, where the exception's own is not for users."""

    name: str
    status: int
    title: str
    retryable: bool = False
    detail: str | None = None


INVALID = Kind("invalid-request", 422, "A value of the request cannot be used")
UNSTORABLE = replace(
    INVALID,
    detail="A value of the request is none that the database can look up: it holds a NUL, or is "
    "too large.",
)
INTERNAL = Kind(
    "internal",
    500,
    "Something broke inside the service",
    retryable=True,
    detail="Something broke inside the service; its log has more under this trace_id.",
)
STORE_AWAY = Kind(
    "store-unavailable",
    503,
    "The store is down",
    retryable=True,
    detail="The store of photographs and results does not answer as it should; try again in a "
    "minute.",
)
DATABASE_AWAY = Kind(
    "database-unavailable",
    503,
    "The database is down",
    retryable=True,
    detail="The database of jobs does not answer; try again in a minute.",
)
DATABASE_FULL = replace(
    DATABASE_AWAY,
    detail="The disk of the database of jobs is full, so that nothing can be written; delete jobs "
    "that have ended, if their files are on the same disk, or ask its operator to make room.",
)

_S3_ERROR = re.compile(r"<\?xml.*?<Code>(\w+)</Code>.*", re.DOTALL)

KINDS: dict[type[Exception], Kind] = {
    pipeline_errors.UnreadableImageError: Kind("unreadable-image", 422, "Not a readable image"),
    pipeline_errors.ImageTooLargeError: Kind("image-too-large", 413, "Too many pixels"),
    pipeline_errors.PairMismatchError: Kind("pair-mismatch", 422, "The frames are no pair"),
    pipeline_errors.UnusablePairError: Kind("unusable-pair", 422, "No light to separate"),
    pipeline_errors.SwappedPairError: Kind("swapped-pair", 422, "The wrong way round, it seems"),
    pipeline_errors.MarkError: Kind("nothing-to-mark", 422, "Nothing to measure was found"),
    pipeline_errors.OptionError: Kind("invalid-option", 422, "An option cannot be used"),
    pipeline_errors.InputError: Kind("invalid-input", 422, "The input cannot be used"),
    drivers.BadAddressError: Kind("bad-camera-address", 422, "No address of a camera"),
    drivers.CameraNotFoundError: Kind("camera-not-found", 404, "No camera answers there"),
    drivers.SettingError: Kind("camera-setting", 422, "The camera does not take this setting"),
    drivers.UnconfirmedError: Kind(
        "not-confirmed", 408, "Nobody confirmed in time", retryable=True
    ),
    drivers.FlashError: Kind(
        "flash-switch-failed", 503, "The switch of the flash failed", retryable=True
    ),
    drivers.DriverError: Kind("camera-failed", 503, "The camera failed", retryable=True),
    MalformedRequestError: Kind("malformed-request", 400, "The request cannot be read"),
    UnauthorizedError: Kind("unauthorized", 401, "A key is needed"),
    ForbiddenError: Kind("forbidden", 403, "The key is not for this"),
    ForeignCameraError: Kind("foreign-camera", 403, "Not a camera of this service"),
    ForeignOriginError: Kind("foreign-origin", 403, "Not a page of this service"),
    StoredQuotaError: Kind("stored-quota", 403, "The key's space is used up"),
    UnknownJobError: Kind("unknown-job", 404, "No such job"),
    UnknownResultError: Kind("unknown-result", 404, "No such result"),
    UnknownCameraError: Kind("unknown-camera", 404, "No such camera"),
    CameraHeldError: Kind("camera-held", 409, "The camera is in use", retryable=True),
    NotReadyError: Kind("not-ready", 409, "The job is not as far as that", retryable=True),
    EndedError: Kind("ended", 409, "The job has ended without that"),
    GoneError: Kind("gone", 410, "The job's files are removed"),
    SlowRequestError: Kind("slow-request", 408, "The request does not come", retryable=True),
    UnknownUploadError: Kind("unknown-upload", 404, "No such upload"),
    OffsetError: Kind("upload-offset", 409, "The upload goes on elsewhere"),
    UnfinishedUploadError: Kind(
        "upload-unfinished", 409, "The upload has not come whole", retryable=True
    ),
    ExpiredUploadError: Kind("upload-expired", 410, "The upload has expired"),
    TusVersionError: Kind("tus-version", 412, "Another version of tus"),
    ChecksumError: Kind("checksum-mismatch", 460, "The checksum does not fit", retryable=True),
    UploadTooLargeError: Kind("upload-too-large", 413, "Too many bytes"),
    UnsupportedMediaError: Kind("unsupported-media-type", 415, "Neither multipart nor JSON"),
    RangeError: Kind("range-not-satisfiable", 416, "The range lies outside the file"),
    ForeignHostError: Kind("foreign-host", 421, "Not the host of this service"),
    IdempotencyError: Kind("idempotency-key-reused", 422, "Idempotency-Key used for another job"),
    QueueFullError: Kind("queue-full", 429, "Too many jobs wait", retryable=True),
    QuotaError: Kind("quota-exceeded", 429, "The key's quota is used up", retryable=True),
    BusyError: Kind("busy", 503, "Too many requests at a time", retryable=True),
    UnreadyError: Kind("service-not-ready", 503, "The service is not ready", retryable=True),
    StorageFullError: Kind("storage-full", 507, "Too little space is left", retryable=True),
    NoProcessError: Kind("no-process", 503, "The machine is out of processes", retryable=True),
    CrashError: Kind("crashed", 500, "The job crashed"),
    MemoryLimitError: Kind("out-of-memory", 500, "The job ran out of memory"),
    TimeLimitError: Kind("timed-out", 500, "The job took too long"),
    FileLimitError: Kind("too-many-files", 500, "The job opened too many files"),
    OutputLimitError: Kind("output-too-large", 500, "The job wrote too much"),
    DeadlineError: Kind("deadline-passed", 500, "The deadline has passed", retryable=True),
    AbandonedError: Kind("abandoned", 500, "The job's attempts were cut short several times"),
    OlderWorkerError: Kind(
        "older-worker", 503, "The workers are older than the service", retryable=True
    ),
    LayersGoneError: Kind("layers-gone", 410, "The layers are gone"),
    obstore_errors.BaseError: STORE_AWAY,
    DBAPIError: DATABASE_AWAY,
    NoConnectionError: DATABASE_AWAY,
    DataError: UNSTORABLE,
}
"""One table from exceptions to problems; a subclass without a row of its own takes its parent's."""


def kind_of(error: Exception) -> Kind:
    """Find the kind of problem that an exception is; INTERNAL for what is in no table."""
    if is_full(error):
        return DATABASE_FULL
    for parent in type(error).__mro__:
        if parent in KINDS:
            return KINDS[parent]
    return INTERNAL


def make_problem(kind: Kind, detail: str, trace_id: str) -> Problem:
    """Make a problem of a kind."""
    return Problem(
        type=f"urn:lightlayers:problem:{kind.name}",
        title=kind.title,
        status=kind.status,
        detail=detail,
        retryable=kind.retryable,
        trace_id=trace_id,
    )


def problem_of(error: Exception, trace_id: str) -> Problem:
    """Make the problem that an exception is. What is in no table keeps its details in the log."""
    kind = kind_of(error)
    return make_problem(kind, kind.detail or str(error), trace_id)


def cause_of(error: Exception) -> str:
    """Give the first line of what went wrong; no library puts a password there.

    Of an S3 store's answer in XML it has the code, like InvalidAccessKeyId; of a file or folder
    that cannot be used its name and the reason.
    """
    original = getattr(error, "orig", None) or error
    if isinstance(original, OSError) and original.filename is not None:
        return f"{original.filename}: {pipeline_errors.reason_of(original)}"
    said = _S3_ERROR.sub(r"\1", str(original).strip())
    return said.partition("\n")[0].rstrip(".")

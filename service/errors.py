"""What the service raises on purpose; service.problems says what users are told of each.

ServiceError
├── MalformedRequestError    the request is not one we understand
├── UnauthorizedError        no key, or none that is good
├── ForbiddenError           the key is not for this
├── ForeignCameraError       a camera that the operator has not allowed
├── ForeignOriginError       a web page of another site asks a service without keys
├── StoredQuotaError         the key's jobs take up all the space that it may use
├── UnknownJobError          no such job
├── UnknownResultError       no such result of a job
├── UnknownCameraError       no such camera
├── CameraHeldError          a job has the camera, or waits for it
├── NotReadyError            the job has no results yet
│   └── EndedError           and it never will: it has ended
├── SlowRequestError         the rest of the request does not come
├── UnknownUploadError       no such upload
├── OffsetError              an upload does not go on there
├── UnfinishedUploadError    an upload that a job names has not come whole
├── ExpiredUploadError       an upload was not gone on with in time
├── TusVersionError          a tus client of another version
├── GoneError                the job's files are removed
├── UploadTooLargeError      more bytes than the limit
├── UnsupportedMediaError    neither multipart nor JSON
├── RangeError               the range lies outside the file
├── ForeignHostError         a Host that a service on loopback does not answer to
├── IdempotencyError         an Idempotency-Key used again for something else
├── QueueFullError           too many jobs wait
├── QuotaError               the key has as many jobs as it may
├── BusyError                too many requests at a time
├── ChecksumError            the bytes of an upload are not those that were sent
├── UnreadyError             the service lacks what it needs to work
├── StorageFullError         too little space is left for another job
├── NoProcessError           the machine has no process left for a task
├── StartError               the service cannot start with its settings
└── AttemptError             what a job's process can die of
    ├── CrashError           it crashed
    ├── MemoryLimitError     it needed more memory than the limit
    │   └── KilledError      the system killed it, most likely for want of memory
    ├── TimeLimitError       it ran longer than the limit
    ├── FileLimitError       it opened more files than the limit
    ├── OutputLimitError     it wrote more than the limit
    ├── DeadlineError        the job had not ended by its deadline
    ├── AbandonedError       several attempts were cut short
    ├── OlderWorkerError     a newer service took the job than does it
    └── LayersGoneError      the layers that it was to mix have been deleted
"""

from __future__ import annotations


class ServiceError(Exception):
    """Root of what the service raises on purpose. The message is one sentence for people."""


class MalformedRequestError(ServiceError):
    """The request is not one we understand."""


class UnauthorizedError(ServiceError):
    """No key, or none that is good."""


class ForbiddenError(ServiceError):
    """The key is good, but not for this."""


class ForeignCameraError(ServiceError):
    """A camera that the operator has not allowed."""


class ForeignOriginError(ServiceError):
    """A web page of another site asks a service that wants no keys."""


class StoredQuotaError(ServiceError):
    """The key's jobs take up all the space that it may use."""


class UnknownJobError(ServiceError):
    """There is no such job."""

    def __init__(self, job_id: str) -> None:
        super().__init__(f"There is no job {job_id[:32]!r}; it may have been deleted.")


class UnknownResultError(ServiceError):
    """The job has no such result."""


class UnknownCameraError(ServiceError):
    """There is no such camera."""


class CameraHeldError(ServiceError):
    """A job has the camera, or waits for it."""


class NotReadyError(ServiceError):
    """The job does not have yet what is asked for."""


class EndedError(NotReadyError):
    """The job has ended without what is asked for."""


class SlowRequestError(ServiceError):
    """The rest of the request does not come."""


class UnknownUploadError(ServiceError):
    """There is no such upload."""


class OffsetError(ServiceError):
    """The upload goes on at another byte."""


class UnfinishedUploadError(ServiceError):
    """An upload that has not come whole."""


class ExpiredUploadError(ServiceError):
    """An upload that was not gone on with in time."""


class TusVersionError(ServiceError):
    """A version of tus that is not spoken here."""


class ChecksumError(ServiceError):
    """The bytes that came do not have the checksum that came with them."""


class GoneError(ServiceError):
    """The job's files are removed, or about to be."""


class UploadTooLargeError(ServiceError):
    """More bytes than the limit."""


class UnsupportedMediaError(ServiceError):
    """A body of a type we do not read."""


class RangeError(ServiceError):
    """The range lies outside the file."""

    def __init__(self, message: str, size: int) -> None:
        super().__init__(message)
        self.size = size


class ForeignHostError(ServiceError):
    """A Host header that a service on loopback does not answer to."""


class IdempotencyError(ServiceError):
    """An Idempotency-Key that was used for another request."""


class QueueFullError(ServiceError):
    """Too many jobs wait."""


class QuotaError(ServiceError):
    """The key has as many jobs as it may."""

    def __init__(self, message: str, retry_seconds: int) -> None:
        super().__init__(message)
        self.retry_seconds = retry_seconds


class BusyError(ServiceError):
    """Too many requests at a time."""


class StorageFullError(ServiceError):
    """Too little space is left for another job."""


class UnreadyError(ServiceError):
    """The service lacks what it needs to work, or stops."""


class NoProcessError(ServiceError):
    """The machine has no process, memory or open file left to begin a task with."""

    def __init__(self) -> None:
        super().__init__(
            "The machine has too few processes, memory or open files to begin with this; send it "
            "again in a minute."
        )


class StartError(ServiceError):
    """The service cannot start with its settings. No request ever meets it."""


class AttemptError(ServiceError):
    """A job's process ended without a result."""


class CrashError(AttemptError):
    """The process crashed."""


class MemoryLimitError(AttemptError):
    """The process needed more memory than its limit."""


class KilledError(MemoryLimitError):
    """The system killed the process, most likely because the machine ran out of memory."""


class TimeLimitError(AttemptError):
    """The process ran longer than its limit."""


class FileLimitError(AttemptError):
    """The process opened more files than its limit."""


class OutputLimitError(AttemptError):
    """The process wrote more than its limit."""


class DeadlineError(AttemptError):
    """The job had not ended by its deadline."""

    def __init__(self) -> None:
        super().__init__(
            "The job had not ended by its deadline; send it again with more time, or when fewer "
            "jobs wait."
        )


class AbandonedError(AttemptError):
    """Several attempts at the job were cut short."""

    def __init__(self, lost: int) -> None:
        super().__init__(
            f"The job was given up because its attempts were cut short {lost} times, each by the "
            "death of the worker or of the process that it works in; these photographs may be "
            "what kills them."
        )


class OlderWorkerError(AttemptError):
    """A newer service took the job than does it; unknown: what the worker says of its options."""

    def __init__(self, unknown: str) -> None:
        super().__init__(
            f"{unknown.rstrip('.')}; the workers are older than the service that took the job: "
            "have its operator upgrade them, then run the job again."
        )


class LayersGoneError(AttemptError):
    """The layers that a job was to mix have been deleted."""

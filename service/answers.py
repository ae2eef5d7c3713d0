"""What the service answers, made of the rows of jobs and cameras."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any, Literal

import sqlalchemy as sa
from pydantic import BaseModel, Field

from pipeline.taken_with import TakenWith
from service.capture import Capture
from service.problems import Problem
from service.rows import eta, jobs, kept, waiting
from service.rows.states import State
from service.settings import Settings

# Of any length: what a camera said is told as it is, also where no request could ask for it.
SaidValue = int | float | str


class InputFile(BaseModel):
    """A photograph as it is stored."""

    sha256: str = Field(description="Hexadecimal; the same as your file's: yours may be deleted.")


class Inputs(BaseModel):
    """The pair of a job."""

    no_flash: InputFile
    flash: InputFile


class ResultFile(BaseModel):
    """One result of a job."""

    name: str
    size: int = Field(description="Bytes.")
    sha256: str
    media_type: str
    href: str


class Links(BaseModel):
    """Where to go from a job; null where there is nothing (yet)."""

    self: str
    cancel: str | None = None
    results: str | None = None
    zip: str | None = None
    confirm: str | None = None


class OperatorRequest(BaseModel):
    """What a person is asked to do."""

    request: str
    until: datetime = Field(description="The job fails when it is not confirmed by then.")


class KeptCalibration(BaseModel):
    """A calibration that is kept for a camera and a set-up."""

    id: str = Field(description="Of its job, which options may name, and DELETE removes.")
    kind: Literal["flash", "camera", "lamps"]
    setup: str
    camera: str = Field(description="Make and model, as its photographs say.")
    made: datetime
    links: Links


class KeptCalibrations(BaseModel):
    """Kept calibrations, newest first."""

    calibrations: list[KeptCalibration]


class WebhookAnswer(BaseModel):
    """The delivery of the job's end to its webhook."""

    url: str
    state: Literal["waiting", "pending", "delivered", "failed"] = Field(
        description="waiting: the job has not ended; failed: given up."
    )
    attempts: int = Field(description="How often it was tried.")
    last_status: int | None = Field(description="HTTP status of its last answer, null without one.")


class JobAnswer(BaseModel):
    """A job as it is now."""

    id: str
    owner: str = Field(description="Id of the key that made it; empty where none was needed.")
    state: State
    priority: jobs.Priority
    stage: str | None = Field(
        description="capture, decode, align, lamps, layers, encode, calibrate or mix."
    )
    fraction: float = Field(ge=0, le=1, description="How much of the stage is done.")
    progress: float = Field(
        ge=0, le=1, description="How much of the whole is done, by time; from 0 in each attempt."
    )
    position: int | None = Field(description="Place in the queue, from 1; null once it runs.")
    eta: datetime | None = Field(
        description="When it is likely to end, by what jobs like it took lately; null: unknown."
    )
    attempt: int = Field(description="How often the job was started.")
    options: dict[str, Any]
    capture: Capture | None
    camera_settings: dict[str, SaidValue] | None = Field(
        description="What the camera was set to for the pair; null until it is taken."
    )
    operator: OperatorRequest | None = Field(
        description="What the job waits for in the state waiting_for_operator; null in others."
    )
    inputs: Inputs | None = Field(description="Null until a camera has taken them.")
    taken_with: TakenWith | None = Field(
        description="Of a calibration that has succeeded, what it was found with; null of others."
    )
    error: Problem | None = Field(description="Why the job failed.")
    files: list[ResultFile]
    created: datetime
    started: datetime | None
    finished: datetime | None
    deadline: datetime | None = Field(description="The job fails when it has not ended by then.")
    expires: datetime | None = Field(
        description="The job and its files are removed then, or once its webhook is told."
    )
    webhook: WebhookAnswer | None
    links: Links

    @classmethod
    def of(cls, job: jobs.Job, position: int | None = None, eta: float | None = None) -> JobAnswer:
        """Make the answer for a row; eta: seconds since 1970."""
        here = f"/jobs/{job.id}"
        done = job.state == State.SUCCEEDED
        return cls(
            id=job.id,
            owner=job.owner,
            state=job.state,
            priority=job.priority,
            stage=job.stage,
            fraction=job.fraction,
            progress=job.progress,
            position=position,
            eta=_time(round(eta)) if eta else None,
            attempt=job.attempt,
            options=job.options,
            capture=Capture(**job.capture) if job.capture else None,
            camera_settings=job.camera_settings,
            operator=_operator(job),
            inputs=Inputs(**job.inputs) if job.inputs else None,
            taken_with=kept.taken_with(job) if done and job.task == "calibrate" else None,
            error=Problem(**job.error) if job.error else None,
            files=[
                ResultFile(**result, href=f"{here}/results/{result['name']}")
                for result in job.results or []
            ],
            created=_time(job.created),
            started=_time(job.started) if job.started else None,
            finished=_time(job.finished) if job.finished else None,
            deadline=_time(job.deadline) if job.deadline else None,
            expires=_time(job.expires) if job.expires else None,
            webhook=_webhook(job),
            links=Links(
                self=here,
                cancel=None if job.ended else f"{here}/cancel",
                results=f"{here}/results" if done else None,
                zip=f"{here}/results.zip" if done else None,
                confirm=f"{here}/confirm?request={job.requests}" if job.request else None,
            ),
        )


class JobPage(BaseModel):
    """Jobs, newest first."""

    jobs: list[JobAnswer]
    next: str | None = Field(
        description="The page of older jobs; null on the last one, and on no other, however few "
        "jobs it has."
    )


class JobList(BaseModel):
    """Jobs that one request made, in order."""

    jobs: list[JobAnswer]


class CameraAnswer(BaseModel):
    """A camera, as it is or as it last told."""

    id: str
    address: str
    make: str
    model: str
    serial: str
    state: Literal["idle", "capturing", "waiting_for_operator", "away", "unable"] = Field(
        description="away: it did not answer when it was last looked for. unable: it answered, and "
        "takes no order to release by this address."
    )
    battery_percent: int | None = Field(description="Null where it does not tell.")
    free_bytes: int | None = Field(
        description="Room on its cards, in bytes; null where it does not tell."
    )
    holder: str | None = Field(
        description="Id of the job that has it; null also for a job that this key may not see."
    )
    waiting: int = Field(description="How many captures wait for it.")


class SettingAnswer(BaseModel):
    """A setting of a camera."""

    value: SaidValue
    choices: list[SaidValue] = Field(description="What it could be; empty where it does not tell.")
    writable: bool = Field(description="False where only a dial on the camera changes it.")


CameraSettings = dict[str, SettingAnswer]


class Health(BaseModel):
    """That the service answers."""

    status: Literal["ok"] = "ok"


def of_jobs(
    connection: sa.Connection, settings: Settings, found: list[jobs.Job]
) -> list[JobAnswer]:
    """Make the answers for jobs, in their order.

    They have their places in the queue, and when they are likely to end.
    """
    places = waiting.positions(connection, found)
    ends = eta.etas(connection, settings, found, places)
    return [JobAnswer.of(job, places.get(job.id), ends.get(job.id)) for job in found]


def _webhook(job: jobs.Job) -> WebhookAnswer | None:
    if job.webhook is None:
        return None
    waiting = {"state": "pending" if job.ended else "waiting", "attempts": 0, "last_status": None}
    return WebhookAnswer(url=job.webhook["url"], **(job.delivery or waiting))


def _operator(job: jobs.Job) -> OperatorRequest | None:
    if job.request is None or job.request_until is None:
        return None
    return OperatorRequest(request=job.request, until=_time(job.request_until))


def _time(seconds: float) -> datetime:
    return datetime.fromtimestamp(seconds, UTC)

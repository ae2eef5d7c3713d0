"""What the API answers and what it takes, as the OpenAPI document shows them."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from pipeline.mix import MixRequest
from pipeline.options import Options
from service import jobs
from service.errors import Problem
from service.states import State


class Capture(BaseModel):
    """Where a pair comes from when it is not uploaded."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    camera: str = Field(min_length=1, description="Address of a camera, like sim://studio.")


class Webhook(BaseModel):
    """Who is told when a job ends, after the Standard Webhooks specification."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    url: str = Field(min_length=1, max_length=2048, description="Takes a POST; https or http.")
    secret: str = Field(
        pattern=r"^whsec_[A-Za-z0-9+/]{32,88}={0,2}$",
        description="whsec_ and base64 of 24 to 64 bytes: the key of the signatures.",
    )


class Handling(BaseModel):
    """How a job is to be dealt with, whatever it does."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    priority: jobs.Priority = Field(
        default="normal", description="What goes first among your own waiting jobs."
    )
    deadline_seconds: float | None = Field(
        default=None, gt=0, description="The job fails when it has not ended after so long."
    )
    webhook: Webhook | None = None


class CaptureRequest(Handling):
    """A job whose pair a camera takes."""

    capture: Capture
    options: Options = Options()


class MixJob(MixRequest, Handling):
    """A job that mixes the layers of another one into a picture of full size."""


class MixOptions(BaseModel):
    """The options of a mix, as its job shows them."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    kind: Literal["mix"]
    of: str = Field(description="Id of the job whose layers are mixed.")
    mix: MixRequest


class Calibrated(BaseModel):
    """What a calibration found, in place of a table."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    calibration: str = Field(description="Id of the job that POST /calibrations made.")


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


class JobAnswer(BaseModel):
    """A job as it is now."""

    id: str
    state: State
    priority: jobs.Priority
    stage: str | None = Field(
        description="capture, decode, align, lamps, layers, encode, calibrate or mix."
    )
    fraction: float = Field(ge=0, le=1, description="How much of the stage is done.")
    position: int | None = Field(description="Place in the queue, from 1; null once it runs.")
    attempt: int = Field(description="How often the job was started.")
    options: dict[str, Any]
    capture: Capture | None
    inputs: Inputs | None = Field(description="Null until a camera has taken them.")
    error: Problem | None = Field(description="Why the job failed.")
    files: list[ResultFile]
    created: datetime
    started: datetime | None
    finished: datetime | None
    deadline: datetime | None = Field(description="The job fails when it has not ended by then.")
    expires: datetime | None = Field(description="The job and its files are removed then.")
    links: Links

    @classmethod
    def of(cls, job: jobs.Job, position: int | None) -> JobAnswer:
        """Make the answer for a row."""
        here = f"/jobs/{job.id}"
        done = job.state == State.SUCCEEDED
        return cls(
            id=job.id,
            state=job.state,
            priority=job.priority,
            stage=job.stage,
            fraction=job.fraction,
            position=position,
            attempt=job.attempt,
            options=job.options,
            capture=Capture(**job.capture) if job.capture else None,
            inputs=Inputs(**job.inputs) if job.inputs else None,
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
            links=Links(
                self=here,
                cancel=None if job.ended else f"{here}/cancel",
                results=f"{here}/results" if done else None,
                zip=f"{here}/results.zip" if done else None,
            ),
        )


class JobPage(BaseModel):
    """Jobs, newest first."""

    jobs: list[JobAnswer]
    next: str | None = Field(description="The page of older jobs; null on the last one.")


class CameraAnswer(BaseModel):
    """A camera that can take a pair."""

    address: str
    make: str
    model: str


class Health(BaseModel):
    """That the service answers."""

    status: Literal["ok"] = "ok"


def _time(seconds: float) -> datetime:
    return datetime.fromtimestamp(seconds, UTC)

"""What the API answers and what it takes, as the OpenAPI document shows them."""

from __future__ import annotations

import base64
from datetime import UTC, datetime
from typing import Annotated, Any, Literal

from pydantic import (
    AllowInfNan,
    BaseModel,
    ConfigDict,
    Field,
    RootModel,
    Strict,
    StringConstraints,
    field_validator,
)

from drivers import SettingName
from pipeline.calibration.options import CalibrationOptions
from pipeline.mix_options import MixRequest
from pipeline.options import Options
from service import jobs
from service.errors import Problem
from service.states import State

FlashStrategy = Literal["property", "external", "operator"]
WhenBusy = Literal["wait", "refuse"]
SettingValue = (
    Annotated[int, Strict()]
    | Annotated[float, Strict(), AllowInfNan(False)]
    | Annotated[str, Strict(), StringConstraints(min_length=1, max_length=64)]
)
CaptureSettings = dict[SettingName, SettingValue]
# Of any length: what a camera said is told as it is, also where no request could ask for it.
SaidValue = int | float | str

_FLASH = (
    "What switches the flash: the camera itself (property), the operator's switch (external), or a "
    "person, for whom the job waits (operator)."
)
_WHEN_BUSY = "While other jobs have the camera or wait for it: wait behind them, or be refused."
_SETTINGS = (
    "Written to the camera and read back before the pair. The flash is the capture's own to "
    "switch, exposure program, focus and drive are manual and single, ISO and white balance fixed."
)
_KEEP = "Leave the photographs on the camera's card; else they go once both are stored for good."


class Capture(BaseModel):
    """Where a pair comes from when it is not uploaded."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    camera: str = Field(
        min_length=1, max_length=300, description="Address of a camera, like sim://studio."
    )
    flash: FlashStrategy = Field(default="property", description=_FLASH)
    when_busy: WhenBusy = Field(default="wait", description=_WHEN_BUSY)
    settings: CaptureSettings = Field(default={}, description=_SETTINGS)
    keep: bool = Field(default=True, description=_KEEP)


class Webhook(BaseModel):
    """Who is told when a job ends, after the Standard Webhooks specification."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    url: str = Field(min_length=1, max_length=2048, description="Takes a POST; https or http.")
    secret: str = Field(
        pattern=r"^whsec_[A-Za-z0-9+/]{32,88}={0,2}$",
        description="whsec_ and base64 of 24 to 64 bytes: the key of the signatures.",
    )

    @field_validator("secret")
    @classmethod
    def _decodable(cls, secret: str) -> str:
        try:
            key = base64.b64decode(secret.removeprefix("whsec_") + "==")
        except ValueError:
            key = b""
        if not 24 <= len(key) <= 64:
            raise ValueError("write whsec_ and base64 of 24 to 64 random bytes")
        return secret


class Handling(BaseModel):
    """How a job is to be dealt with, whatever it does."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    priority: jobs.Priority = Field(
        default="normal",
        description="While many jobs wait, 16 high ones or 4 normal ones go for each low one.",
    )
    deadline_seconds: float | None = Field(
        default=None,
        gt=0,
        le=366 * 86400,
        description="The job fails when it has not ended after so long.",
    )
    webhook: Webhook | None = None


class CaptureRequest(Handling):
    """A job whose pair a camera takes."""

    capture: Capture
    options: Options = Options()


class CameraCapture(Handling):
    """Pairs that a camera takes, one job each."""

    like: str | None = Field(
        default=None,
        description="Id of a job whose pair a camera took: the same flash, options and settings of "
        "the camera, unless they are given here.",
    )
    flash: FlashStrategy = Field(default="property", description=_FLASH)
    when_busy: WhenBusy = Field(default="wait", description=_WHEN_BUSY)
    settings: CaptureSettings = Field(default={}, description=_SETTINGS)
    keep: bool = Field(default=True, description=_KEEP)
    pairs: int = Field(default=1, ge=1, le=1000, description="How many pairs.")
    interval_seconds: float = Field(
        default=0,
        ge=0,
        le=86400,
        allow_inf_nan=False,
        description="Between the moments at which the pairs are due, the first at once; those that "
        "were due while the camera was busy follow one right after the other.",
    )
    options: Options = Options()


class SettingsRequest(RootModel[Annotated[CaptureSettings, Field(min_length=1)]]):
    """Settings of a camera to write, by name."""


class MixJob(MixRequest, Handling):
    """A job that mixes the layers of another one into a picture of full size."""


class MixOptions(BaseModel):
    """The options of a mix, as its job shows them."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    kind: Literal["mix"]
    of: str = Field(description="Id of the job whose layers are mixed.")
    mix: MixRequest


class UploadedPair(BaseModel):
    """Photographs that were sent before, by POST /uploads."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    no_flash: str = Field(description="Id of a finished upload: the last part of its URL.")
    flash: str = Field(description="The same for the photograph with the flash.")


class UploadsRequest(Handling):
    """A job whose pair was uploaded before; it takes the uploads over, so that they are gone."""

    uploads: UploadedPair
    options: Options = Options()


class CalibrationCaptureRequest(Handling):
    """A calibration whose pair a camera takes."""

    capture: Capture
    options: CalibrationOptions


class CalibrationRequest(Handling):
    """A calibration whose pair was uploaded before; it takes the uploads over."""

    uploads: UploadedPair
    options: CalibrationOptions


class RerunRequest(Handling):
    """Another job on the photographs of one."""

    options: dict[str, Any] | None = Field(
        default=None,
        description="In place of those of the job, and of the same kind; null: the same ones.",
    )


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
    """What came of telling a webhook that the job has ended."""

    url: str
    state: Literal["waiting", "pending", "delivered", "failed"] = Field(
        description="waiting: the job has not ended; failed: given up."
    )
    attempts: int = Field(description="How often it was told.")
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
    next: str | None = Field(description="The page of older jobs; null on the last one.")


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
    state: Literal["idle", "capturing", "waiting_for_operator", "away"] = Field(
        description="away: it did not answer when it was last looked for."
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

"""What the API takes, as the OpenAPI document shows it."""

from __future__ import annotations

import base64
import re
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, RootModel, field_validator

from pipeline.calibration.options import CalibrationOptions
from pipeline.mixes.mix_options import MixRequest
from pipeline.options import Options
from service.capture import Capture, CaptureSettings, Taking
from service.rows import jobs

_SECRET = r"^whsec_[A-Za-z0-9+/]{32,88}={0,2}$"


def _whole(value: Any) -> Any:
    # JSON has one kind of number, and its schemas take 2.0 for an integer.
    return int(value) if isinstance(value, float) and value.is_integer() else value


class Webhook(BaseModel):
    """Who is told when a job ends, after the Standard Webhooks specification."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    url: str = Field(min_length=1, max_length=2048, description="Takes a POST; https or http.")
    secret: str = Field(
        json_schema_extra={"pattern": _SECRET},  # pydantic would tell it to people
        description="whsec_ and base64 of 24 to 64 bytes: the key of the signatures.",
    )

    @field_validator("secret")
    @classmethod
    def _decodable(cls, secret: str) -> str:
        try:
            key = base64.b64decode(secret.removeprefix("whsec_") + "==")
        except ValueError:
            key = b""
        if not re.fullmatch(_SECRET, secret) or not 24 <= len(key) <= 64:
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

    @property
    def webhook_url(self) -> str | None:
        """Where the webhook is, if there is one."""
        return self.webhook.url if self.webhook else None


class CaptureRequest(Handling):
    """A job whose pair a camera takes."""

    capture: Capture
    options: Options = Options()


class CameraCapture(Taking, Handling):
    """Pairs that a camera takes, one job each."""

    like: str | None = Field(
        default=None,
        description="Id of a job whose pair a camera took: the same flash, `keep`, options and "
        "settings of the camera, unless they are given here.",
    )
    pairs: Annotated[int, BeforeValidator(_whole)] = Field(
        default=1, ge=1, le=1000, description="How many pairs."
    )
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
    swapped: bool = Field(
        default=False,
        description="The photograph with the flash is the one that was without it, and the other "
        "way round.",
    )


class Calibrated(BaseModel):
    """What a calibration found, in place of a table."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    calibration: str = Field(description="Id of the job that POST /calibrations made.")

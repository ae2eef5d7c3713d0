"""What a camera is to do for a job's pair: requests ask for it, rows keep it, answers show it."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AllowInfNan, BaseModel, ConfigDict, Field, Strict, StringConstraints

from drivers import SettingName

FlashStrategy = Literal["property", "external", "operator"]
WhenBusy = Literal["wait", "refuse"]
SettingValue = (
    Annotated[int, Strict()]
    | Annotated[float, Strict(), AllowInfNan(False)]
    | Annotated[str, Strict(), StringConstraints(min_length=1, max_length=64)]
)
CaptureSettings = dict[SettingName, SettingValue]


class Taking(BaseModel):
    """How a camera is to take a pair."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    flash: FlashStrategy = Field(
        default="property",
        description="What switches the flash: the camera itself (property), the operator's switch "
        "(external), or a person, for whom the job waits (operator).",
    )
    when_busy: WhenBusy = Field(
        default="wait",
        description="While other jobs have the camera or wait for it: wait behind them, or be "
        "refused.",
    )
    settings: CaptureSettings = Field(
        default={},
        description="Written to the camera and read back before the pair. The flash is the "
        "capture's own to switch, exposure program, focus and drive are manual and single, ISO and "
        "white balance fixed.",
    )
    keep: bool = Field(
        default=True,
        description="Leave the photographs on the camera's card; else they go once both are stored "
        "for good, and the JPEGs of RAW + JPEG, which are stored nowhere else, stay.",
    )


class Capture(Taking):
    """Where a pair comes from when it is not uploaded."""

    camera: str = Field(
        min_length=1, max_length=300, description="Address of a camera, like sim://studio."
    )

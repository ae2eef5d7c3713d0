"""What a calibration may be asked for, shared by command line, HTTP API and OpenAPI document."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, TypeAdapter, field_validator, model_validator

from pipeline.options import (
    NO_SETUP,
    Circle,
    FocalLength,
    LampCount,
    PairOptions,
    Sensitivities,
    SetUp,
    Spectrum,
    SpectrumName,
)
from pipeline.taken_with import Kind

Point = tuple[float, float]

Corners = Annotated[
    tuple[Point, Point, Point, Point],
    Field(
        description="Middles (x, y) of the ColorChecker's outer patches in pixels of the "
        "photograph without the flash: dark skin, bluish green, black, white."
    ),
]


class KeptOptions(PairOptions):
    """How what is found is kept."""

    setup: SetUp | None = Field(
        default=None,
        description="Name of a set-up for which it is kept: later jobs on photographs of this "
        "camera that name the set-up use it, and all that name none where it is `default`.",
    )

    @field_validator("setup")
    @classmethod
    def _can_be_used(cls, value: str | None) -> str | None:
        if value == NO_SETUP:
            raise ValueError(
                f"separations of the set-up {NO_SETUP} go without calibrations; give another name"
            )
        return value


class FlashCalibration(KeptOptions):
    """The spectrum of a flash, from a grey card or a ColorChecker and a known camera."""

    kind: Literal["flash"]
    card: Circle | None = Field(
        default=None,
        description="A circle that lies wholly on a grey card. Without it and `chart` a "
        "ColorChecker is looked for.",
    )
    chart: Corners | None = None
    camera: SpectrumName | Sensitivities | None = Field(
        default=None, description="Name of a measured camera, or its table; default from EXIF."
    )

    @model_validator(mode="after")
    def _not_both(self) -> FlashCalibration:
        if self.card is not None and self.chart is not None:
            raise ValueError("mark either a grey card or a ColorChecker")
        return self


class CameraCalibration(KeptOptions):
    """A camera's spectral sensitivities, from a ColorChecker."""

    kind: Literal["camera"]
    chart: Corners | None = Field(default=None, description="When missing, it is looked for.")
    flash_spectrum: SpectrumName | Spectrum | None = Field(
        default=None,
        description="Name of a flash or light source, or its table; when missing, the likeliest.",
    )


class LampsCalibration(KeptOptions):
    """Directions, strengths and colours of distant lamps, from a matt grey or a mirror sphere."""

    kind: Literal["lamps"]
    sphere: Circle | None = Field(
        default=None, description="The outline of the sphere; when missing, it is looked for."
    )
    mirror: bool = Field(
        default=False,
        description="The sphere is a mirror: lamps are seen by their highlights; their strengths "
        "and colours only where no highlight is clipped.",
    )
    lights: LampCount = Field(default="auto", description="Number of lamps.")
    focal_px: FocalLength | None = Field(
        default=None,
        description="Focal length in pixels; default from EXIF, else 50 mm-equivalent.",
    )


CalibrationOptions = Annotated[
    FlashCalibration | CameraCalibration | LampsCalibration, Field(discriminator="kind")
]
CALIBRATION_OPTIONS: TypeAdapter[FlashCalibration | CameraCalibration | LampsCalibration] = (
    TypeAdapter(CalibrationOptions)
)
"""Reads the options of any kind of calibration."""

FILES: dict[Kind, str] = {"flash": "flash.json", "camera": "camera.json", "lamps": "lights.json"}
"""The file that a calibration of each kind writes, as the option of a separation reads it."""

"""What a calibration may be asked for, shared by command line, HTTP API and OpenAPI document."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, TypeAdapter, model_validator

from pipeline.options import Circle, PairOptions, Sensitivities, Spectrum

Point = tuple[float, float]


Corners = Annotated[
    tuple[Point, Point, Point, Point],
    Field(
        description="Middles (x, y) of the ColorChecker's outer patches in pixels of the "
        "photograph without the flash: dark skin, bluish green, black, white."
    ),
]


class FlashCalibration(PairOptions):
    """The spectrum of a flash, from a grey card or a ColorChecker and a known camera."""

    kind: Literal["flash"]
    card: Circle | None = Field(
        default=None, description="A circle that lies wholly on a grey card."
    )
    chart: Corners | None = None
    camera: str | Sensitivities | None = Field(
        default=None, description="Name of a measured camera, or its table; default from EXIF."
    )

    @model_validator(mode="after")
    def _one_of_two(self) -> FlashCalibration:
        if (self.card is None) == (self.chart is None):
            raise ValueError("mark either a grey card or a ColorChecker")
        return self


class CameraCalibration(PairOptions):
    """A camera's spectral sensitivities, from a ColorChecker."""

    kind: Literal["camera"]
    chart: Corners
    flash_spectrum: str | Spectrum | None = Field(
        default=None,
        description="Name of a flash or light source, or its table; when missing, the likeliest.",
    )


class LampsCalibration(PairOptions):
    """Directions, strengths and colours of distant lamps, from a matt grey sphere."""

    kind: Literal["lamps"]
    sphere: Circle = Field(description="The outline of the sphere.")
    lights: Literal["auto", 1, 2, 3] = Field(default="auto", description="Number of lamps.")
    focal_px: float | None = Field(
        default=None,
        gt=0,
        description="Focal length in pixels; default from EXIF, else 50 mm-equivalent.",
    )


CalibrationOptions = Annotated[
    FlashCalibration | CameraCalibration | LampsCalibration, Field(discriminator="kind")
]
CALIBRATION_OPTIONS: TypeAdapter[FlashCalibration | CameraCalibration | LampsCalibration] = (
    TypeAdapter(CalibrationOptions)
)
"""Reads the options of any kind of calibration."""

FILES = {"flash": "flash.json", "camera": "camera.json", "lamps": "lights.json"}
"""The file that a calibration of each kind writes, as the option of a separation reads it."""

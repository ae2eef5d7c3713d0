"""What a user may ask for, shared by command line, HTTP API and OpenAPI document."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

Vector = tuple[float, float, float]
OUTPUT_NAMES = (
    "layers.exr",
    "lamps.tif",
    "lamps.jpg",
    "white_balanced_1.jpg",
    "white_balanced_2.jpg",
    "confidence.tif",
    "gamma.png",
    "residual.png",
    "normals.png",
    "normals.exr",
    "depth.exr",
    "white_balanced_1.tif",
    "white_balanced_2.tif",
    "white_balanced.exr",
    "response.jpg",
)
"""Names for `outputs`; lamps.tif and lamps.jpg stand for one file per lamp. manifest.json is
always written, normals and depth only with light directions, depth not with the method paper,
response.jpg only with a response."""


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Spectrum(_Strict):
    """A spectral power distribution."""

    wavelength_nm: list[float] = Field(min_length=2, description="Ascending, in nanometres.")
    power: list[Annotated[float, Field(ge=0)]] = Field(description="Relative power per wavelength.")

    @model_validator(mode="after")
    def _aligned(self) -> Spectrum:
        _check_table(self.wavelength_nm, self.power)
        return self


class Sensitivities(_Strict):
    """A camera's spectral sensitivities."""

    wavelength_nm: list[float] = Field(min_length=2, description="Ascending, in nanometres.")
    r: list[float] = Field(description="Relative response of the red channel per wavelength.")
    g: list[float] = Field(description="Relative response of the green channel per wavelength.")
    b: list[float] = Field(description="Relative response of the blue channel per wavelength.")

    @model_validator(mode="after")
    def _aligned(self) -> Sensitivities:
        _check_table(self.wavelength_nm, self.r, self.g, self.b)
        return self


class DirectedLight(_Strict):
    """A distant lamp whose place is known."""

    direction: Vector = Field(
        description="From the surface to the lamp; x right, y up, z to the viewer; any length."
    )
    strength: float | None = Field(
        default=None,
        gt=0,
        description="Brightness on a white card that faces the lamp, relative to the others; "
        "unknown when missing.",
    )
    rgb: Vector | None = Field(
        default=None,
        description="The lamp's colour on a grey card, camera RGB: says which lamp is meant.",
    )

    @field_validator("direction", "rgb")
    @classmethod
    def _not_zero(cls, value: Vector | None) -> Vector | None:
        if value is not None and not any(value):
            raise ValueError("must not be zero in all three components")
        return value


class Options(_Strict):
    """Options of a separation."""

    lights: Literal["auto", 1, 2, 3] = Field(default="auto", description="Number of lamps.")
    method: Literal["best", "paper"] = Field(
        default="best", description="paper: as published (Hui et al. 2018); best: ours."
    )
    basis: Literal["wpca", "pca", "joint"] = Field(
        default="wpca", description="How the bases of reflectances and lights are learnt."
    )
    camera: str | Sensitivities | None = Field(
        default=None, description="Name of a measured camera, or its table; default from EXIF."
    )
    flash_spectrum: str | Spectrum = Field(
        default="xenon", description="Name of a flash or light source, or its table."
    )
    encoding: Literal["auto", "linear", "srgb"] = Field(
        default="auto",
        description="How pixel values are encoded; auto: RAW and DNG linear, 8-bit sRGB, 16-bit "
        "integer and float TIFF and EXR linear.",
    )
    flash_only: bool = Field(
        default=False, description="The flash file already is the flash part alone."
    )
    exposure_ratio: float | None = Field(
        default=None,
        gt=0,
        description="Flash frame's exposure ÷ no-flash frame's; default from EXIF, else 1.",
    )
    align: bool = Field(default=True, description="Warp the flash frame onto the other.")
    neutral: str | Spectrum = Field(
        default="D65", description="The light white-balanced pictures are shown under."
    )
    light_directions: list[DirectedLight] | None = Field(
        default=None,
        min_length=2,
        max_length=3,
        description="Two or three distant lamps, for normals; the flash is one more light.",
    )
    response: str | Sensitivities | None = Field(
        default=None, description="Camera through which the picture is shown anew."
    )
    focal_px: float | None = Field(
        default=None,
        gt=0,
        description="Focal length in pixels; default from EXIF, else 50 mm-equivalent.",
    )
    outputs: Literal["default", "all"] | list[str] = Field(
        default="default", description=f"Files to write: {', '.join(OUTPUT_NAMES)}."
    )

    @field_validator("lights", mode="before")
    @classmethod
    def _at_most_three(cls, value: object) -> object:
        if isinstance(value, bool):
            raise ValueError("the number of lamps is 1, 2, 3 or auto")
        if isinstance(value, int) and value > 3:
            raise ValueError(
                "more than three lamps have no unique answer with three colour channels and one "
                "flash; ask for 1, 2, 3 or auto"
            )
        return value

    @model_validator(mode="after")
    def _known_outputs(self) -> Options:
        unknown = set(self.outputs) - set(OUTPUT_NAMES) if isinstance(self.outputs, list) else ()
        if unknown:
            raise ValueError(
                f"unknown output {', '.join(sorted(unknown))}; known are {', '.join(OUTPUT_NAMES)}"
            )
        return self


def _check_table(wavelengths: list[float], *columns: list[float]) -> None:
    if any(len(column) != len(wavelengths) for column in columns):
        raise ValueError("every column of a spectral table must be as long as wavelength_nm")
    if any(b <= a for a, b in pairwise(wavelengths)):
        raise ValueError("wavelength_nm must ascend")
    if wavelengths[0] > 420 or wavelengths[-1] < 660:
        raise ValueError("a spectral table must cover 420 to 660 nm")
    if any(not any(value > 0 for value in column) for column in columns):
        raise ValueError("a spectral table must not be all zero")

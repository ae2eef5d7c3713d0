"""What a user may ask for, shared by command line, HTTP API and OpenAPI document."""

from __future__ import annotations

import re
from itertools import pairwise
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    Tag,
    WithJsonSchema,
    field_validator,
    model_validator,
)

from pipeline.output_names import OUTPUT_NAMES, outputs_with
from pipeline.taken_with import TakenWith

Vector = tuple[float, float, float]
_NotNegative = Annotated[float, Field(ge=0)]
_SETUP_NAME = r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,39}$"


def _check_setup(name: str) -> str:
    if not re.fullmatch(_SETUP_NAME, name):
        raise ValueError(
            "such a name has 1 to 40 of the letters A to Z and a to z, digits, dots, dashes and "
            "underscores, and begins with a letter or digit"
        )
    return name


SetUp = Annotated[
    str, AfterValidator(_check_setup), Field(json_schema_extra={"pattern": _SETUP_NAME})
]
"""Name of a set-up of camera, flash and lamps."""
NO_SETUP = "none"
"""The set-up of separations that go without kept calibrations."""
FocalLength = Annotated[float, Field(ge=10, le=1e6)]
"""In pixels: from a fisheye on a thumbnail to a telescope."""
Quality = Literal["best", "balanced", "fast"]
Method = Literal["best", "paper"]
"""Ours, or the published one (Hui et al. 2018)."""


def _at_most_three(value: object) -> object:
    if isinstance(value, bool):
        raise ValueError("the number of lamps is 1, 2, 3 or auto")
    if isinstance(value, int) and value > 3:
        raise ValueError(
            "more than three lamps have no unique answer with three colour channels and one "
            "flash; ask for 1, 2, 3 or auto"
        )
    return value


LampCount = Annotated[
    Literal["auto", 1, 2, 3],
    BeforeValidator(_at_most_three),
    # Programs that make clients out of the schema know no list of words and numbers.
    WithJsonSchema(
        {"anyOf": [{"const": "auto", "type": "string"}, {"enum": [1, 2, 3], "type": "integer"}]}
    ),
]
"""How many lamps are asked for; "auto": the program counts them."""


MOST_ROWS = 2000
"""Of a spectral table: of 0.2 nm where the light is visible. Whatever asks for a job is kept and
told with it, and many jobs are told at once."""
SpectrumName = Annotated[str, Field(max_length=200)]
"""Name of a camera or a light."""


class Strict(BaseModel):
    """What is asked for: no unknown names, no infinite numbers."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


FoundWith = Annotated[
    TakenWith | None,
    Field(
        description="Of what a calibration found, the photographs that it was found with: a "
        "separation of others warns of that."
    ),
]


class Spectrum(Strict):
    """A spectral power distribution."""

    wavelength_nm: list[float] = Field(
        min_length=2, max_length=MOST_ROWS, description="Ascending, in nanometres."
    )
    power: list[_NotNegative] = Field(
        max_length=MOST_ROWS, description="Relative power per wavelength."
    )
    taken_with: FoundWith = None

    @model_validator(mode="after")
    def _aligned(self) -> Spectrum:
        _check_table(self.wavelength_nm, self.power)
        return self


class Sensitivities(Strict):
    """A camera's spectral sensitivities."""

    wavelength_nm: list[float] = Field(
        min_length=2, max_length=MOST_ROWS, description="Ascending, in nanometres."
    )
    r: list[float] = Field(
        max_length=MOST_ROWS, description="Relative response of the red channel per wavelength."
    )
    g: list[float] = Field(
        max_length=MOST_ROWS, description="Relative response of the green channel per wavelength."
    )
    b: list[float] = Field(
        max_length=MOST_ROWS, description="Relative response of the blue channel per wavelength."
    )
    taken_with: FoundWith = None

    @model_validator(mode="after")
    def _aligned(self) -> Sensitivities:
        _check_table(self.wavelength_nm, self.r, self.g, self.b)
        return self


class DirectedLight(Strict):
    """A distant lamp whose place is known."""

    direction: Vector = Field(
        description="From the surface to the lamp; x right, y up, z to the viewer; any length."
    )
    strength: float | None = Field(
        default=None,
        ge=1e-6,
        le=1e6,
        description="Brightness on a white card that faces the lamp, relative to the others; "
        "unknown when missing.",
    )
    rgb: tuple[_NotNegative, _NotNegative, _NotNegative] | None = Field(
        default=None,
        description="The lamp's colour on a grey card, camera RGB: says which lamp is meant.",
    )
    taken_with: FoundWith = None

    @field_validator("direction", "rgb")
    @classmethod
    def _not_zero(cls, value: Vector | None) -> Vector | None:
        if value is not None and not any(value):
            raise ValueError("must not be zero in all three components")
        return value


class Circle(Strict):
    """A circle in the photograph without the flash, in pixels from its upper left corner."""

    x: float = Field(description="Of the middle, to the right.")
    y: float = Field(description="Of the middle, downwards.")
    radius: float = Field(gt=0)


def _kind_of_lamp(value: Any) -> str:
    if isinstance(value, Spectrum) or (isinstance(value, dict) and "wavelength_nm" in value):
        return "table"
    return "area" if isinstance(value, Circle | dict) else "name"


KnownLamp = Annotated[
    Annotated[Circle, Tag("area")]
    | Annotated[Spectrum, Tag("table")]
    | Annotated[SpectrumName, Tag("name")],
    Discriminator(_kind_of_lamp),
]
"""A lamp by the light of an area, which is its alone, or by its spectrum."""


MOST_EXPOSURE_RATIO = 1000.0
"""Exposures that differ more, one way or the other, are taken for a mistake."""


class PairOptions(Strict):
    """How the two photographs are read and laid together."""

    encoding: Literal["auto", "linear", "srgb"] = Field(
        default="auto",
        description="How pixel values are encoded; auto: RAW and DNG linear, 8-bit sRGB, 16-bit "
        "integer and float TIFF and EXR linear; files with an ICC profile, PNG with a "
        "cICP, sRGB, gAMA or cHRM chunk, and EXR with chromaticities as that says.",
    )
    flash_only: bool = Field(
        default=False, description="The flash file already is the flash part alone."
    )
    exposure_ratio: float | None = Field(
        default=None,
        ge=1 / MOST_EXPOSURE_RATIO,
        le=MOST_EXPOSURE_RATIO,
        description="Flash frame's exposure ÷ no-flash frame's; default from EXIF, else as the "
        "pair shows it, else 1.",
    )
    align: bool = Field(default=True, description="Warp the flash frame onto the other.")


class Options(PairOptions):
    """Options of a separation."""

    setup: SetUp = Field(
        default="default",
        description="Set-up whose kept calibrations of this camera stand in for `camera`, "
        "`flash_spectrum` and `light_directions` where these are not given; `none`: none of them.",
    )

    lights: LampCount = Field(default="auto", description="Number of lamps.")
    method: Method = Field(
        default="best", description="paper: as published (Hui et al. 2018); best: ours."
    )
    quality: Quality = Field(
        default="best",
        description="How widely the method best averages noise: best over 41 × 41 pixels, "
        "balanced over 17 × 17 and fast over 7 × 7. docs/performance.md says what that loses and "
        "saves.",
    )
    basis: Literal["wpca", "pca", "joint"] = Field(
        default="wpca", description="How the bases of reflectances and lights are learnt."
    )
    camera: SpectrumName | Sensitivities | None = Field(
        default=None, description="Name of a measured camera, or its table; default from EXIF."
    )
    flash_spectrum: SpectrumName | Spectrum = Field(
        default="xenon", description="Name of a flash or light source, or its table."
    )
    neutral: SpectrumName | Spectrum = Field(
        default="D65", description="The light white-balanced pictures are shown under."
    )
    light_directions: list[DirectedLight] | None = Field(
        default=None,
        min_length=2,
        max_length=3,
        description="All lamps there are, two or three distant ones, for normals; the flash is one "
        "more light.",
    )
    pinned_lamps: list[KnownLamp] = Field(
        default=[],
        max_length=3,
        description="Lamps that are among those found: a disc of the photograph without the flash "
        "that one lamp lights alone, or the name or table of a spectrum. With the method best.",
    )
    forbidden_lamps: list[KnownLamp] = Field(
        default=[],
        max_length=10,
        description="Lights that none of the other lamps may come near, as pinned_lamps are given.",
    )
    response: SpectrumName | Sensitivities | None = Field(
        default=None,
        description="Camera through which the photograph and each layer are shown anew.",
    )
    focal_px: FocalLength | None = Field(
        default=None,
        description="Focal length in pixels; default from EXIF, else 50 mm-equivalent.",
    )
    normals: Literal["gl", "dx"] = Field(
        default="gl",
        description="Where y of written normals points: gl up, as OpenGL has it, dx down, as "
        "DirectX has it.",
    )
    outputs: Literal["default", "all"] | Annotated[list[str], Field(max_length=100)] = Field(
        default="default", description=f"Files to write: {', '.join(OUTPUT_NAMES)}."
    )

    @model_validator(mode="after")
    def _lamps_in_keeping(self) -> Options:
        pinned, forbidden = self.pinned_lamps, self.forbidden_lamps
        if (pinned or forbidden) and self.method == "paper":
            raise ValueError(
                "the method paper finds lamps as published, which leaves no room for pinned or "
                "forbidden ones; use the method best"
            )
        for done, lamps in (("pinned", pinned), ("forbidden", forbidden)):
            if any(lamp in lamps[:place] for place, lamp in enumerate(lamps)):
                raise ValueError(f"the same lamp is {done} twice")
        if any(lamp in forbidden for lamp in pinned):
            raise ValueError("a lamp cannot be pinned and forbidden at once")
        most = self.number_of_lamps
        if most != "auto" and len(pinned) > most:
            raise ValueError(
                f"{len(pinned)} lamps are pinned and only {most} asked for; pin fewer, or ask for "
                "more"
            )
        given = self.light_directions
        if given is not None and most != "auto" and len(given) < most:
            raise ValueError(
                f"there are {len(given)} light directions, and {most} lamps are asked for; give a "
                "direction for each lamp, or ask for fewer"
            )
        return self

    @property
    def number_of_lamps(self) -> LampCount:
        """The number of lamps asked for, which their directions tell, too."""
        if self.lights != "auto" or self.light_directions is None:
            return self.lights
        return 3 if len(self.light_directions) == 3 else 2

    @model_validator(mode="after")
    def _known_outputs(self) -> Options:
        if not isinstance(self.outputs, list):
            return self
        if unknown := set(self.outputs) - set(OUTPUT_NAMES):
            raise ValueError(
                f"unknown output {', '.join(sorted(unknown))}; known are {', '.join(OUTPUT_NAMES)}"
            )
        through = [name for name in self.outputs if name in outputs_with("response")]
        if through and self.response is None:
            raise ValueError(
                f"the output {through[0]} needs a response: name the camera to look through"
            )
        surface = [name for name in self.outputs if name in outputs_with("surface")]
        if surface and self.method == "paper":
            raise ValueError(
                f"the output {surface[0]} is not made by the method paper, which finds normals "
                "alone: leave it out, or use the method best"
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

"""What is asked of a mix, and what a manifest tells of it: without what does the mixing."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError, model_validator

from pipeline.colour.temperature import CCT_RANGE_K
from pipeline.errors import InputError, OptionError, counted
from pipeline.options import Strict, Vector

Matrix3x3 = tuple[Vector, Vector, Vector]


class LampMix(Strict):
    """What becomes of the light of one lamp."""

    on: bool = Field(default=True, description="Off: the lamp's light is left out.")
    ev: float = Field(
        default=0.0, ge=-10.0, le=10.0, description="Brighter (positive) or darker, in stops."
    )
    neutral: bool = Field(
        default=False, description="The lamp's light as if it were the neutral light."
    )
    temperature_k: float | None = Field(
        default=None,
        ge=CCT_RANGE_K[0],
        le=CCT_RANGE_K[1],
        description="Colour temperature in kelvin that the lamp's light gets, its brightness kept.",
    )
    tint: float = Field(
        default=0.0,
        ge=-150.0,
        le=150.0,
        description="With a temperature: pink (positive) or green (negative), -3000 times Duv.",
    )
    rgb: tuple[
        Annotated[float, Field(ge=0.0, le=100.0)],
        Annotated[float, Field(ge=0.0, le=100.0)],
        Annotated[float, Field(ge=0.0, le=100.0)],
    ] = Field(
        default=(1.0, 1.0, 1.0),
        description="Factors of linear red, green and blue (sRGB), like a gel before the lamp.",
    )

    @model_validator(mode="after")
    def _tint_of_a_temperature(self) -> LampMix:
        if self.tint and self.temperature_k is None:
            raise ValueError("a tint needs a temperature beside it, like 5000 K with a tint of 10")
        return self


class Mix(Strict):
    """Settings of all lamps: a preset of the page."""

    lamps: list[LampMix] = Field(
        min_length=1, max_length=3, description="One for each lamp of the job, in its order."
    )


class MixRequest(Mix):
    """A mix and the file to make of it."""

    format: Literal["jpeg", "tiff", "exr"] = Field(
        default="jpeg",
        description="jpeg: 8-bit sRGB; tiff: 16-bit linear Rec. 2020; exr: 16-bit float, linear "
        "sRGB, not cut off at white.",
    )


class LampBasis(Strict):
    """white: CIE XYZ of a white card under the lamp as the photograph is shown, Y = 1. own_white:
    the same as people see it, of the temperature that is told of the lamp; None where it has none,
    and in manifests of before, which tell that of white. neutral_to_xyz: camera RGB of the lamp's
    layer → CIE XYZ as under the neutral light.
    """  # noqa: D205

    white: Vector
    own_white: Vector | None = None
    neutral_to_xyz: Matrix3x3


class MixBasis(Strict):
    """What mixing starts from, a part of the manifest.

    to_xyz: camera RGB → CIE XYZ, 1.0 = white of the screen, for the photograph as it is shown.
    neutral: CIE XYZ of the neutral light, Y = 1. clipping: the value at which the photograph is
    clipped, None where it is not, and in manifests of before.
    """

    to_xyz: Matrix3x3
    neutral: Vector
    clipping: float | None = None
    lamps: list[LampBasis]


def read_basis(manifest: dict[str, Any]) -> MixBasis:
    """Find in a manifest what mixing starts from. Raises InputError where it is not there."""
    try:
        return MixBasis.model_validate(manifest["mix"])
    except (KeyError, TypeError, ValidationError) as error:
        raise InputError(
            "The manifest does not say how its layers are mixed: separate the pair anew with this "
            "version."
        ) from error


def check_lamps(basis: MixBasis, mix: Mix) -> None:
    """Raise OptionError where the mix is one of another number of lamps."""
    if len(mix.lamps) != len(basis.lamps):
        lamps = counted(len(mix.lamps), "lamp", "lamps")
        raise OptionError(
            f"The mix has settings for {lamps}, and the photograph has "
            f"{len(basis.lamps)}: give as many."
        )

"""A mix: the light of every lamp with a brightness and a colour of its own, added up again.

out = tone(Σ_k 2^ev_k · diag(rgb_k) · A_k · B_k · layer_k). B_k takes camera RGB to linear sRGB as
the photograph is shown or, for a neutral lamp, as the layer would be under the neutral light; A_k
adapts the light's colour to the wanted temperature. Settings that are left alone give the
photograph. The page computes the same (service/page/mix.js).
"""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from pipeline.canvas import shown_gain
from pipeline.colour.spaces import XYZ_TO_SRGB, adaptation
from pipeline.colour.temperature import CCT_RANGE_K, white_of
from pipeline.errors import OptionError
from pipeline.frames import Image, Matrix
from pipeline.lamps import Lamps
from pipeline.model import Model
from pipeline.options import Strict, Vector
from pipeline.white_balance import from_layers, neutral_white, whites_of

TINT_PER_DUV = -3000.0
"""Steps of tint for a Duv of 1, as raw developers count them: positive is pink, negative green."""

_DIGITS = 7

Rows = tuple[Vector, Vector, Vector]


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
        description="With a temperature: pink (positive) or green (negative), 3000 times Duv.",
    )
    rgb: tuple[
        Annotated[float, Field(ge=0.0, le=100.0)],
        Annotated[float, Field(ge=0.0, le=100.0)],
        Annotated[float, Field(ge=0.0, le=100.0)],
    ] = Field(
        default=(1.0, 1.0, 1.0),
        description="Factors of linear red, green and blue (sRGB), like a gel before the lamp.",
    )


class Mix(Strict):
    """Settings of all lamps: a preset of the page."""

    lamps: list[LampMix] = Field(
        min_length=1, max_length=3, description="One for each lamp of the job, in its order."
    )


class MixRequest(Mix):
    """A mix and the file to make of it."""

    format: Literal["jpeg", "tiff", "exr"] = Field(
        default="jpeg",
        description="jpeg: 8-bit sRGB; tiff: 16-bit linear Rec. 2020; exr: 32-bit float, linear "
        "sRGB, not cut off at white.",
    )


class LampBasis(Strict):
    """white: CIE XYZ of a white card under the lamp, Y = 1. neutral_to_xyz: camera RGB of the
    lamp's layer → CIE XYZ as under the neutral light.
    """  # noqa: D205

    white: Vector
    neutral_to_xyz: Rows


class MixBasis(Strict):
    """What mixing starts from, a part of the manifest.

    to_xyz: camera RGB → CIE XYZ, 1.0 = white of the screen, for the photograph as it is shown.
    neutral: CIE XYZ of the neutral light, Y = 1.
    """

    to_xyz: Rows
    neutral: Vector
    lamps: list[LampBasis]


def mix_basis(photograph: Image, lamps: Lamps, model: Model) -> MixBasis:
    """Make what mixing the layers of a photograph (H, W, 3) starts from."""
    gain = shown_gain(photograph, XYZ_TO_SRGB @ model.camera_to_xyz)
    whites = whites_of(lamps, model) @ model.camera_to_xyz.T
    neutral = model.neutral_to_xyz @ neutral_white(model)
    matrices = gain * model.neutral_to_xyz @ from_layers(lamps, model)
    return MixBasis.model_validate(
        {
            "to_xyz": _rounded(gain * model.camera_to_xyz),
            "neutral": _rounded(neutral / neutral[1]),
            "lamps": [
                {"white": _rounded(white / white[1]), "neutral_to_xyz": _rounded(matrix)}
                for white, matrix in zip(whites, matrices, strict=True)
            ],
        }
    )


def mix_matrices(basis: MixBasis, mix: Mix) -> Matrix:
    """Matrices (N, 3, 3) from the layers to linear sRGB, 1.0 = white of the screen.

    Raises OptionError where the mix is one of another number of lamps.
    """
    if len(mix.lamps) != len(basis.lamps):
        raise OptionError(
            f"The mix has settings for {len(mix.lamps)} lamps, and the photograph has "
            f"{len(basis.lamps)}: give as many."
        )
    return np.stack(
        [_matrix(basis, lamp, one) for lamp, one in zip(basis.lamps, mix.lamps, strict=True)]
    )


def mixed(layers: NDArray[np.float32], matrices: Matrix) -> Image:
    """Add up layers (N, h, W, 3), each through its matrix: (h, W, 3)."""
    total = np.zeros(layers.shape[1:], np.float32)
    for layer, matrix in zip(layers, matrices.astype(np.float32), strict=True):
        if matrix.any():
            total += layer @ matrix.T
    return total


def _matrix(basis: MixBasis, lamp: LampBasis, settings: LampMix) -> Matrix:
    if not settings.on:
        return np.zeros((3, 3))
    shown = np.array(lamp.neutral_to_xyz if settings.neutral else basis.to_xyz)
    if settings.temperature_k is not None:
        white = np.array(basis.neutral if settings.neutral else lamp.white)
        wanted = white_of(settings.temperature_k, settings.tint / TINT_PER_DUV)
        shown = adaptation(white, wanted) @ shown
    gel = 2.0**settings.ev * np.array(settings.rgb)
    return np.asarray(gel[:, None] * (XYZ_TO_SRGB @ shown))


def _rounded(values: NDArray[np.float64]) -> list[float]:
    rounded: list[float] = np.round(values, _DIGITS).tolist()
    return rounded

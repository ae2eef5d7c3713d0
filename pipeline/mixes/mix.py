"""A mix: the light of every lamp with a brightness and a colour of its own, added up again.

out = tone(Σ_k 2^ev_k · diag(rgb_k) · M · A_k · B_k · layer_k). B_k takes camera RGB to CIE XYZ as
the photograph is shown or, for a neutral lamp, as the layer would be under the neutral light; A_k
adapts XYZ to the wanted temperature, from the lamp's white as it is shown or, where that is none to
adapt from, from the neutral light; M takes XYZ to linear sRGB; tone is what JPEGs and screens need
(encode.jpeg.to_srgb8), and linear files do without. Settings that are left alone, and a lamp's own
temperature, give the photograph. The page computes the same (service/page/mix.js).
"""

from __future__ import annotations

import numpy as np

from pipeline.arrays import Floats32, Floats64
from pipeline.colour.spaces import XYZ_TO_SRGB, adaptation, adapts
from pipeline.colour.temperature import cct_duv, white_of
from pipeline.images.frames import Image, Matrix, Photograph
from pipeline.lamps.lamps import Lamps
from pipeline.light.model import Model
from pipeline.mixes.mix_options import LampBasis, LampMix, Mix, MixBasis, check_lamps
from pipeline.pictures.clipped import shown_layers
from pipeline.pictures.shown import shown_gain
from pipeline.pictures.white_balance import from_layers, neutral_white, whites_of

TINT_PER_DUV = -3000.0
"""Steps of tint for a Duv of 1, as raw developers count them: positive is pink, negative green."""

_NOWHERE = 1e-12  # square of a distance between whites
_DIGITS = 7  # that count: files of float values may go to any height


def mix_basis(photograph: Photograph, clipping: float, lamps: Lamps, model: Model) -> MixBasis:
    """Make what mixing the layers of a photograph (H, W, 3) starts from.

    clipping: the value at which it is clipped, infinite where it is not.
    """
    gain = shown_gain(photograph, XYZ_TO_SRGB @ model.camera_to_xyz)
    whites = whites_of(lamps, model) @ model.camera_to_xyz.T
    own_whites = (model.lamp_white(matrix) for matrix in lamps.matrices)
    neutral = model.neutral_to_xyz @ neutral_white(model)
    matrices = gain * model.neutral_to_xyz @ from_layers(lamps, model)
    return MixBasis.model_validate(
        {
            "to_xyz": _rounded(gain * model.camera_to_xyz),
            "neutral": _rounded(neutral / neutral[1]),
            "clipping": clipping if np.isfinite(clipping) else None,
            "lamps": [
                {
                    "white": _rounded(white / white[1]),
                    "own_white": None if cct_duv(own) is None else _rounded(own / own[1]),
                    "neutral_to_xyz": _rounded(matrix),
                }
                for white, own, matrix in zip(whites, own_whites, matrices, strict=True)
            ],
        }
    )


def mix_matrices(basis: MixBasis, mix: Mix) -> Matrix:
    """Matrices (N, 3, 3) from the layers to linear sRGB, 1.0 = white of the screen.

    Raises OptionError where the mix is one of another number of lamps.
    """
    check_lamps(basis, mix)
    return np.stack(
        [_matrix(basis, lamp, one) for lamp, one in zip(basis.lamps, mix.lamps, strict=True)]
    )


def to_be_mixed(layers: Floats32, basis: MixBasis) -> Floats32:
    """Layers (N, h, W, 3) as they are shown: clipped light has the colour of its lamp."""
    if basis.clipping is None:
        return layers
    whites = np.array([lamp.white for lamp in basis.lamps]) @ np.linalg.inv(basis.to_xyz).T
    return shown_layers(layers, whites, basis.clipping)


def mixed(layers: Floats32, matrices: Matrix) -> Image:
    """Add up layers (N, h, W, 3), each through its matrix: (h, W, 3)."""
    total = np.zeros(layers.shape[1:], np.float32)
    for layer, matrix in zip(layers, matrices.astype(np.float32), strict=True):
        if matrix.any():
            total += layer @ matrix.T
    return total


def _matrix(basis: MixBasis, lamp: LampBasis, settings: LampMix) -> Matrix:
    if not settings.on:
        return np.zeros((3, 3))
    white = np.array(lamp.white)
    neutral = settings.neutral or (settings.temperature_k is not None and not adapts(white))
    shown = np.array(lamp.neutral_to_xyz if neutral else basis.to_xyz)
    if settings.temperature_k is not None:
        wanted = white_of(settings.temperature_k, settings.tint / TINT_PER_DUV)
        if neutral:
            white = np.array(basis.neutral)
        else:
            wanted = _as_shown(wanted, lamp)
        shown = adaptation(white, wanted) @ shown
    gel = 2.0**settings.ev * np.array(settings.rgb)
    return np.asarray(gel[:, None] * (XYZ_TO_SRGB @ shown))


def _as_shown(wanted: Floats64, lamp: LampBasis) -> Floats64:
    """White (3,) for a wanted one, CIE XYZ: a lamp's own stays as it is shown, others are exact.

    One matrix for all light shows a lamp in not quite its own colour (Model.lamp_white). The
    difference fades within about its own size, so that no slider jumps or turns back.
    """
    own = np.array(lamp.own_white or lamp.white)
    off, away = np.array(lamp.white) - own, wanted - own
    return np.asarray(wanted + off * np.exp(-(away @ away) / max(off @ off, _NOWHERE)))


def _rounded(values: Floats64) -> list[float]:
    rounded = [float(f"{value:.{_DIGITS}g}") for value in values.flat]
    kept: list[float] = np.reshape(rounded, values.shape).tolist()
    return kept

"""Surface normals from three lamps of known directions.

Source: Hui et al. 2018, supplement, flash/no-flash photometric stereo; after Woodham 1980.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats32, Floats64
from pipeline.errors import OptionError
from pipeline.images.frames import Image, Matrix
from pipeline.lamps.lamps import Lamps
from pipeline.light.model import Model
from pipeline.light.shares import shares
from pipeline.options import DirectedLight
from pipeline.pair.reduced import ReducedPair
from pipeline.photometric_stereo.directions import likely_orders, unit_directions
from pipeline.separation.separation import Strip
from pipeline.vectors import unit

_MIN_PIXELS = 50  # that tell strengths
_HELD, _HARDLY_HELD = 0.002, 0.001  # how firmly strengths given, or not, are where they start
_MIN_GAIN = 0.05  # on a lamp's column: less, and no strengths explain the light
_MIN_LIT = 0.02  # of a lamp's strong pixels: darker ones are in its shadow
_MIN_SHARE = 0.01  # of a pixel's strongest lamp: less is what noise leaves of a lamp's shadow
_MIN_CONFIDENCE = 0.2  # see Strip
_MIN_FACING = 0.05  # n·v of a visible surface


@dataclass(frozen=True)
class DirectedLamps:
    """The three lamps whose directions the user told, in the order of the user's list.

    matrices: (3, 3, 3) T_j, flash part → lamp. greens: (3,) green response of a white card that
    lamp j lights like the flash does. inverse: (3, 3) L⁻¹ of the directions, each column by its
    lamp's strength e: relative brightness q → scaled normal. strengths: (3,) e, relative, as given
    or as estimated.
    """

    matrices: Matrix
    greens: Floats64
    inverse: Floats64
    strengths: Floats64


def assign_lamps(
    lights: Sequence[DirectedLight],
    reduced: ReducedPair,
    lamps: Lamps,
    model: Model,
    focal_px: float,
) -> DirectedLamps:
    """Tell which of the lamps found shines from which direction, and how strong each is.

    lights: three directions. Every assignment that goes with the `rgb` given is tried, and the one
    taken whose normals are most integrable. Where all three have `rgb`, lamps of these colours are
    tried, too, in place of those found. Strengths follow from the flash, which sits at the camera:
    relative to it, the scaled normal has the same component towards the camera in every pixel.
    focal_px: of the full-size picture.
    Raises OptionError for directions nearly in a plane, and when there are not three lamps.
    """
    inverse = inverse_directions(lights)
    candidates = _candidates(lights, lamps, model)
    view = _view(reduced, focal_px)
    tried = []
    for matrices in candidates:
        greens = (matrices @ model.flash_white)[:, 1]
        q = _relative_brightness(
            reduced.no_flash, reduced.flash, matrices, greens, lamps.channel_weights
        )
        use = reduced.usable & _lit_by_all(q)
        strengths, spread = _strengths(lights, inverse, q[:, use], view[use])
        field = _field(inverse / strengths, q)
        tried.append((_unevenness(field, use) + spread, strengths, matrices, greens))
    _, strengths, matrices, greens = min(tried, key=lambda one: one[0])
    return DirectedLamps(matrices, greens, inverse / strengths, strengths)


def inverse_directions(lights: Sequence[DirectedLight]) -> Floats64:
    """L⁻¹ (3, 3) of the unit directions to three lamps.

    Raises OptionError for another number of them, and for directions that fix no normals.
    """
    if len(lights) != 3:
        raise OptionError(
            f"The published normals need three light directions, and there are {len(lights)}: "
            "give three, or ask for the method best."
        )
    return np.linalg.inv(unit_directions(lights)).astype(np.float64)


def _candidates(lights: Sequence[DirectedLight], lamps: Lamps, model: Model) -> list[Matrix]:
    """Matrices (3, 3, 3) that the lamps may have, in the order of the lights."""
    found: list[Matrix] = []
    if len(lamps) == len(lights):
        orders = likely_orders(lights, lamps.matrices @ model.flash_white)
        found = [lamps.matrices[list(order)] for order in orders]
    if not all(light.rgb for light in lights):
        if not found:
            raise OptionError(
                f"Normals need three lamps, and the number found is {len(lamps)}: ask for three, "
                "or give the rgb of each light."
            )
        return found
    colours = unit(np.array([light.rgb for light in lights], dtype=np.float64))
    return [model.lamp_matrix(colours), *found]


def published_normals(strip: Strip, lamps: Lamps, directed: DirectedLamps) -> Image:
    """Unit normals (h, W, 3), n ∝ L⁻¹(q/e): x right, y up, z to the viewer.

    NaN where one of the lamps does not shine, where nothing is known of the flash part, and where
    the surface would face away.
    """
    q = _relative_brightness(
        strip.no_flash, strip.flash, directed.matrices, directed.greens, lamps.channel_weights
    )
    field = _field(directed.inverse, q)
    lit = (q > _MIN_SHARE * q.max(axis=0)).all(axis=0)
    known = lit & (strip.confidence > _MIN_CONFIDENCE) & (field[..., 2] > 0)
    return np.where(known[..., None], field, np.float32(np.nan))


def _relative_brightness(
    no_flash: Image, flash: Image, matrices: Matrix, greens: Floats64, weights: Floats64
) -> Floats32:
    """q_j (3, h, W), green response of a white card under each lamp ÷ the same under the flash."""
    predicted = np.stack([flash @ matrix.T.astype(np.float32) for matrix in matrices])
    w = weights.astype(np.float32)
    return np.asarray(
        shares(no_flash * w, predicted * w) * greens[:, None, None].astype(np.float32)
    )


def _field(inverse: Floats64, q: Floats32) -> Image:
    """Unit vectors (h, w, 3) along L⁻¹(q/e)."""
    return unit(np.einsum("cj,jhw->hwc", inverse, q)).astype(np.float32)


def _lit_by_all(q: Floats32) -> NDArray[np.bool_]:
    """Pixels lit by every lamp: q above a small part of its bright values."""
    bright = np.quantile(q, 0.9, axis=(1, 2), keepdims=True)
    return np.asarray((q > _MIN_LIT * bright).all(axis=0))


def _view(reduced: ReducedPair, focal_px: float) -> Floats64:
    """Unit vectors (h, w, 3) from the surface to the camera."""
    height, width = reduced.usable.shape
    y, x = np.mgrid[:height, :width].astype(np.float64)
    focal, middle = focal_px / reduced.block, reduced.middle
    view = np.stack([-(x - middle[0]) / focal, (y - middle[1]) / focal, np.ones_like(x)], axis=-1)
    return unit(view)


def _strengths(
    lights: Sequence[DirectedLight], inverse: Floats64, q: Floats32, view: Floats64
) -> tuple[Floats64, float]:
    """Strengths e (3,) that make v·L⁻¹(q/e) the same in all pixels (n,), and how far it is not.

    Strengths given are where the search starts and hold where pixels say little (all surfaces
    parallel): an error of the lamps' matrices is an error of q's scale, so that even a strength
    known exactly is not the one that gives the best normals.
    """
    given = np.array([light.strength or 0.0 for light in lights])
    start = np.where(given > 0, given, np.mean(given[given > 0]) if given.any() else 1.0)
    if q.shape[1] < _MIN_PIXELS:
        return start, np.inf
    columns = (view @ inverse) * q.T / start  # (n, 3); gains on them make their sum constant
    columns = columns / np.median(columns.sum(axis=1))
    held = np.sqrt(len(columns)) * np.where(given > 0, _HELD, _HARDLY_HELD)
    weight = np.ones(len(columns))
    gains = np.ones(3)
    for _ in range(10):
        design = np.concatenate([columns * weight[:, None], np.diag(held)])
        target = np.concatenate([weight, held])
        gains = np.linalg.lstsq(design, target, rcond=None)[0]
        error = np.abs(columns @ gains - 1.0)
        weight = 1.0 / np.sqrt(1.0 + (error / (3 * np.median(error) + 1e-9)) ** 2)
    spread = float(np.quantile(error, 0.75))
    if (gains <= _MIN_GAIN).any():
        return start, np.inf
    return start / gains, spread


def _unevenness(field: Image, use: NDArray[np.bool_]) -> float:
    """How far normals (h, w, 3) are from those of a surface: mean of curl ÷ change of slopes.

    use: (h, w), the pixels that count; of these, such as would face away count as fully uneven.
    """
    facing = field[..., 2]
    slope = -field[..., :2] / np.where(np.abs(facing) < _MIN_FACING, _MIN_FACING, facing)[..., None]
    slope[..., 1] *= -1  # rows run down, y runs up
    dy, dx = slope[1:, :-1] - slope[:-1, :-1], slope[:-1, 1:] - slope[:-1, :-1]
    inner = use[:-1, :-1] & use[1:, :-1] & use[:-1, 1:]
    if not inner.any():
        return np.inf
    curl = np.abs(dy[..., 0] - dx[..., 1])[inner]
    change = (np.abs(dy).sum(axis=-1) + np.abs(dx).sum(axis=-1))[inner] + 1e-6
    uneven = np.where(facing[:-1, :-1][inner] > _MIN_FACING, curl / change, 1.0)
    return float(uneven.mean())

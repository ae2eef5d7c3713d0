"""From a reduced pair and lamps of known directions to a surface."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from pipeline.arrays import Floats64
from pipeline.errors import OptionError, UnusablePairError
from pipeline.images.frames import Mask
from pipeline.lamps.lamps import Lamps
from pipeline.light.model import Model
from pipeline.options import DirectedLight
from pipeline.pair.reduced import ReducedPair
from pipeline.photometric_stereo.directions import likely_orders, unit_directions
from pipeline.photometric_stereo.fit import MOST_TRIAL_TICKS, fit, fit_turned, refine, unexplained
from pipeline.photometric_stereo.grid import carried
from pipeline.photometric_stereo.parts import MOST_TICKS, fit_in_parts, parts_of
from pipeline.photometric_stereo.responses import LampBank, ResponsePrior, floored
from pipeline.photometric_stereo.scene import (
    Scene,
    State,
    directions,
    predicted,
    response_matrices,
    responses,
)
from pipeline.photometric_stereo.sides import sides
from pipeline.photometric_stereo.view import View, make_view
from pipeline.progress import Progress
from pipeline.vectors import angles_deg

_TRIAL, _COARSE, _FINE = 1_200, 5_000, 60_000  # pixels at most
_MIN_PIXELS = 100  # that tell a surface
_ASTRAY = 1.5  # coarse pixels that a cut may lie beside the jump
_MOST_CORRECTION = 2.0  # factor on the light of a lamp


@dataclass(frozen=True)
class Surface:
    """The surface in the picture, at a reduced size.

    block: side of one of its pixels in pixels of the picture. mask: bool (h, w), where it is known.
    cut: bool (h, w), where the fit leaves it out, and all is as beside it.
    w: (h, w, 3) normals of length D²/(n·v), D the distance to the camera and v the direction to it.
    z: (h, w) depth along the camera's axis, 1 in the median. lit: (h, w, J) 0 or 1, by which lamps.
    deviations: (h, w, J, 3) of the surface's material from the lamps' matrices, by the flash part's
    sum of channels. correction: (h, w, 3) light that the fit gives ÷ light there is. All of them 0
    outside the mask.
    directions: (J, 3) unit. turned_deg: by how much the light turned one of them at most from what
    was given. matrices: (J, 3, 3) flash part → light of each lamp where l·w is 1.
    misfit: median relative light that the fit does not explain.
    unexplained: share of the pixels whose light it does not explain, or that it leaves out.
    strengths: (J,) green brightness of a white card that faces the lamp, the largest 1.
    focal_px: of the picture.
    """

    block: int
    mask: Mask
    cut: Mask
    w: Floats64
    z: Floats64
    lit: Floats64
    deviations: Floats64
    correction: Floats64
    directions: Floats64
    turned_deg: float
    matrices: Floats64
    misfit: float
    unexplained: float
    strengths: Floats64
    focal_px: float


def solve_surface(
    lights: Sequence[DirectedLight],
    reduced: ReducedPair,
    lamps: Lamps,
    model: Model,
    focal_px: float,
    progress: Progress,
) -> Surface:
    """Fit surface, materials and lamps to the pair, whose flash sits at the camera.

    lights: two or three distant lamps, all that there are. With `rgb` for all of them their colours
    are known, and which is which, also where fewer lamps were found; else they are those of the
    lamps found, in the order that explains the pair best of those in which lamps are most like the
    `rgb` that is given. focal_px: of the full-size picture, through whose middle the camera's axis
    goes. progress: told of the second half of the stage "lamps".
    Raises OptionError for directions nearly alike or in a plane, where more lamps were found, and
    where fewer were without `rgb` for all; UnusablePairError where hardly anything is lit, or all
    that is lies thinly; Canceled.
    """
    given = unit_directions(lights)
    if reduced.usable.sum() < _MIN_PIXELS:
        raise UnusablePairError(
            "Too few pixels show both lamps and flash for normals: bring the flash nearer or raise "
            "its power."
        )
    bank = LampBank(model.camera.sensitivities, model.flash)
    priors = [tuple(bank.prior(*one) for one in few) for few in _likely(lights, lamps, model)]
    sizes = (_COARSE, _FINE) if len(priors) == 1 else (_TRIAL, _COARSE, _FINE)
    views = {most: make_view(reduced, focal_px, most) for most in sizes}
    if min(view.mask.sum() for view in views.values()) < _MIN_PIXELS:
        raise UnusablePairError(
            "The pixels that show both lamps and flash lie too thinly or scattered for normals, "
            "as on wires and nets: photograph a surface that is whole, or bring the flash nearer "
            "where it lights only spots of one."
        )
    materials = views[_COARSE].materials()

    def scene(most: int, priors: tuple[ResponsePrior, ...]) -> Scene:
        return views[most].scene(given, priors, materials)

    orders = 0 if len(priors) == 1 else len(priors)
    tick = progress.ticks("lamps", 0.5, 1.0, MOST_TICKS + orders * MOST_TRIAL_TICKS)
    likeliest = priors[0]
    if len(priors) > 1:
        likeliest = min(priors, key=lambda some: fit(scene(_TRIAL, some), tick, rounds=0)[1])
    coarse, state = fit_in_parts(scene(_COARSE, likeliest), tick)
    state = fit_turned(coarse, state)
    steps = views[_COARSE].step, views[_FINE].step
    fine, belongs = _in_parts(scene(_FINE, likeliest), views, coarse.grid.mask)
    h = carried(state.h, coarse.grid, fine.grid, steps[1] / steps[0])
    explained = np.sum(~unexplained(coarse, state)) / views[_COARSE].mask.sum()
    state = refine(fine, h, state)
    return _surface(fine, state, model, reduced.block * steps[1], belongs, 1.0 - float(explained))


def _in_parts(fine: Scene, views: dict[int, View], kept: Mask) -> tuple[Scene, NDArray[np.intp]]:
    """The fine scene without what the coarse fit, whose pixels are kept, has cut.

    Returns as well which part (h, w) each of its pixels belongs to, from 1.
    """
    mask = fine.grid.mask
    cut = views[_COARSE].mask & ~kept
    if not cut.any():
        return fine, mask.astype(np.intp)
    steps = views[_COARSE].step, views[_FINE].step
    inside = mask & ~_finer(cut, *steps, mask.shape)
    parts = parts_of(inside)
    if not parts.any():  # lines that the coarse view bridges leave crumbs of it
        parts = np.where(inside, _finer(parts_of(kept), *steps, mask.shape), 0)
    flash, light = (picture.sum(axis=2) for picture in (views[_FINE].flash, views[_FINE].light))
    belongs = sides(flash, light, mask, parts, _ASTRAY * steps[0] / steps[1])
    return fine.without(((parts == 0) | (parts != belongs))[mask]), belongs


def _likely(
    lights: Sequence[DirectedLight], lamps: Lamps, model: Model
) -> list[list[tuple[Floats64, bool, Floats64 | None]]]:
    """What the lamps may be, in the order of the lights, each as arguments of LampBank.prior."""
    given = np.array([light.strength or 0.0 for light in lights])
    strengths = np.where(given > 0, given, given[given > 0].mean() if given.any() else 1.0)
    counts = f"There are {len(lights)} light directions, and the number of lamps is {len(lamps)}"
    if len(lamps) > len(lights):  # whose light would be taken for that of those that are given
        raise OptionError(f"{counts}: give a direction for each lamp.")
    whites = lamps.matrices @ model.flash_white
    if all(light.rgb for light in lights):
        rgb = np.array([light.rgb for light in lights], dtype=np.float64)
        found: list[Floats64 | None] = [None] * len(lights)
        if len(lamps) == len(lights):
            found = list(lamps.matrices[list(likely_orders(lights, whites)[0])])
        return [
            [(one, True, m) for one, m in zip(_of_strength(rgb, strengths), found, strict=True)]
        ]
    if len(lamps) < len(lights):
        raise OptionError(
            f"{counts}: give the directions of those lamps alone, or the rgb of each light."
        )
    return [
        [
            (one, False, lamps.matrices[lamp])
            for one, lamp in zip(_of_strength(whites[list(order)], strengths), order, strict=True)
        ]
        for order in likely_orders(lights, whites)
    ]


def _of_strength(rgb: Floats64, strengths: Floats64) -> Floats64:
    """Colours (n, 3) whose green is the lamp's strength."""
    positive = floored(rgb)
    return np.asarray(positive * (strengths / positive[:, 1])[:, None])


def _finer(
    picture: NDArray[Any], coarse_step: int, fine_step: int, shape: tuple[int, ...]
) -> NDArray[Any]:
    """A picture (h, w) of the coarse view on the fine one."""
    y, x = (
        np.minimum((np.arange(size) + 0.5) * fine_step / coarse_step, limit - 1).astype(np.intp)
        for size, limit in zip(shape, picture.shape, strict=True)
    )
    return picture[np.ix_(y, x)]


def _surface(
    scene: Scene,
    state: State,
    model: Model,
    block: int,
    belongs: NDArray[np.intp],
    off_share: float,
) -> Surface:
    """belongs: as of _in_parts; what was cut out is as beside it in its own part.

    off_share: as `unexplained` of Surface.
    """
    fitted, mask = scene.grid.mask, belongs > 0
    places = _nearest_fitted(fitted, belongs)

    def field(values: Floats64) -> Floats64:
        picture = np.zeros((*fitted.shape, *values.shape[1:]))
        picture[fitted] = values
        return np.where(np.expand_dims(mask, (*range(2, picture.ndim),)), picture[*places], 0.0)

    matrices, deviations = response_matrices(scene, state)
    strengths = _strengths(scene, state, model.flash_white)
    explained, towards = predicted(scene, state), directions(scene, state)
    ratio = explained / np.maximum(scene.light, 1e-9)
    off = np.abs(explained - scene.light).sum(axis=1)
    z = np.sqrt(state.h[scene.grid.corners].mean(axis=1))
    return Surface(
        block=block,
        mask=mask,
        cut=mask & ~fitted,
        w=field(scene.grid.w(state.h)),
        z=field(z / np.median(z)),
        lit=field(state.lit.astype(np.float64)),
        deviations=field(deviations),
        correction=field(np.clip(ratio, 1 / _MOST_CORRECTION, _MOST_CORRECTION)),
        directions=towards,
        turned_deg=float(angles_deg((towards * scene.directions).sum(axis=1)).max()),
        matrices=matrices,
        misfit=float(np.median(off / scene.light.sum(axis=1))),
        unexplained=off_share,
        strengths=strengths / strengths.max(),
        focal_px=scene.grid.focal_px * block,
    )


def _nearest_fitted(fitted: Mask, belongs: NDArray[np.intp]) -> NDArray[np.intp]:
    """Rows and columns (2, h, w) of the nearest fitted pixel of the part that each belongs to."""
    places = np.zeros((2, *fitted.shape), np.intp)
    for part in np.unique(belongs[fitted]):
        others = ~(fitted & (belongs == part))
        nearest = ndimage.distance_transform_edt(
            others, return_distances=False, return_indices=True
        )
        places = np.where(belongs == part, nearest, places)
    return places


def _strengths(scene: Scene, state: State, flash_white: Floats64) -> Floats64:
    """Green brightness (J,) of a white card that faces each lamp.

    A gain that the deviations of all materials share is the lamp's: light tells of both together.
    """
    matrices, _ = response_matrices(scene, state)
    by_matrix = (scene.flash @ matrices[:, 1].T).sum(axis=0)
    light = responses(scene, state)[..., 1].sum(axis=0)
    shared = np.divide(light, by_matrix, out=np.ones_like(light), where=by_matrix > 0)
    return np.asarray((matrices @ flash_white)[:, 1] * shared)

"""Fit of a sphere's outline, of the flash's place and of distant lamps to the light on the sphere.

All in one least-squares problem: an outline marked a pixel aside turns every normal, and would
turn lamps by as much and more.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from pipeline.arrays import Floats64
from pipeline.calibration.lamps_and_flash import LampsAndFlash
from pipeline.calibration.sphere import SphereView, view_sphere
from pipeline.options import Circle
from pipeline.vectors import unit

_FACING = 0.25  # least cosine between a normal and the camera; beyond, the flash is faint
_UNEVEN = 0.01  # relative variation of paint
_MARK = 0.02  # standard deviation of the marked outline, of the radius
_ASIDE = 0.05  # the same of the flash's place, of the distance
_GRID = 90  # directions among which lamps are first looked for
_STARTS = 3  # sets of such directions that are followed to the end
_BEHIND = 0.5  # how far behind the sphere a lamp may be that lights its visible side
_COMMON = 6  # unknowns of outline and flash


@dataclass(frozen=True)
class SpherePixels:
    """Where pixels of a sphere lie.

    x, y: (n,) of the pixels from the upper left corner. circle: the outline as marked. focal_px:
    focal length in pixels. size: (width, height) of the picture.
    """

    x: Floats64
    y: Floats64
    circle: Circle
    focal_px: float
    size: tuple[int, int]

    def view(self, moved: Floats64) -> SphereView:
        """Where the pixels face when the outline is moved by (dx, dy, dr) radii."""
        circle = self.circle
        dx, dy, wider = moved * circle.radius
        outline = Circle(x=circle.x + dx, y=circle.y + dy, radius=circle.radius + wider)
        return view_sphere(outline, self.x, self.y, self.focal_px, self.size)


@dataclass(frozen=True)
class SphereLight(SpherePixels):
    """Pixels of a sphere, and the light that they show. lights: of each, all (n, 3)."""

    lights: LampsAndFlash


@dataclass(frozen=True)
class SphereFit:
    """What was fitted.

    directions, colours: (N, 3) of the lamps. deviations_deg: (N,) of the directions. moved:
    (3,) the outline, in radii. flash_aside_deg: at the sphere, from the camera. cost: half the
    mean robust square of the error by its deviation. misfit, flash_misfit: root mean square error
    of the lamps' light and of the flash part by their means, no finite numbers without light.
    """

    directions: Floats64
    colours: Floats64
    deviations_deg: Floats64
    moved: Floats64
    flash_aside_deg: float
    cost: float
    misfit: float
    flash_misfit: float


def fit_lamps(seen: SphereLight, count: int) -> SphereFit:
    """Fit so many lamps; of several starts the one that ends best."""
    problem = _Problem(seen, seen.view(np.zeros(3)))
    fits = [problem.solve(start) for start in _starts(problem, count)]
    return min(fits, key=lambda fit: fit.cost)


def fit_one_more(seen: SphereLight, fit: SphereFit) -> SphereFit:
    """Fit one lamp more than a fit has, beside its own, from where it explains the most."""
    problem = _Problem(seen, seen.view(np.zeros(3)))
    return problem.solve(_with_another(problem, fit.directions))


class _Problem:
    """The light that is to be explained.

    Unknowns: the outline's move (3), the flash's place (2) and log power, and per lamp two steps
    across its starting direction. The lamps' colours follow from them, being linear (variable
    projection, Golub and Pereyra 1973).
    """

    def __init__(self, seen: SphereLight, view: SphereView) -> None:
        facing = (view.normals * view.towards).sum(axis=1) > _FACING
        self._pixels = SpherePixels(
            seen.x[facing], seen.y[facing], seen.circle, seen.focal_px, seen.size
        )
        lights = seen.lights
        self.normals = view.normals[facing]
        self._flash = lights.flash.sum(axis=1)[facing]
        self._light = lights.lamps[facing]
        power = (view.normals * view.towards).sum(axis=1)[facing] / view.distance[facing] ** 2
        self._power = max(float((power @ self._flash) / (power @ power)), 1e-9)
        flash_variance = lights.flash_variance.sum(axis=1)[facing]
        self._flash_deviation = np.sqrt(
            flash_variance + (_UNEVEN * np.maximum(self._flash, 0.1 * self._power)) ** 2
        )
        relative = flash_variance / np.maximum(self._flash, 0.01 * self._power) ** 2
        floor = (_UNEVEN * max(float(self._light.mean()), 1e-9)) ** 2
        self._deviation = np.sqrt(
            lights.lamps_variance[facing]
            + self._light**2 * (relative + _UNEVEN**2)[:, None]
            + floor
        )
        self._albedo = self._flash / (self._power * power)

    @property
    def even(self) -> Floats64:
        """Light (n, 3) of the lamps as on an evenly painted sphere."""
        return np.asarray(self._light / np.maximum(self._albedo, 0.05)[:, None])

    @property
    def weight(self) -> Floats64:
        """One over the deviation (n,) of `even`."""
        deviation = np.sqrt(np.square(self._deviation).mean(axis=1))
        return np.asarray(np.maximum(self._albedo, 0.05) / deviation)

    def solve(self, directions: Floats64) -> SphereFit:
        """Fit everything together, from lamps in these directions (N, 3)."""
        frames = np.array([_frame(direction) for direction in directions])
        count = 2 * len(frames)
        end = least_squares(
            lambda values: self._errors(frames, values),
            np.zeros(_COMMON + count),
            loss="soft_l1",
            x_scale=np.concatenate([np.full(_COMMON, 0.02), np.full(count, 0.3)]),
            ftol=1e-10,
            xtol=1e-6,
            max_nfev=60,
        )
        outline, flash, steps = np.split(end.x, [3, _COMMON])
        towards = _turned(frames, steps)
        lamp_errors, colours = self._lamp_errors(self._pixels.view(outline), flash, towards)
        missed = lamp_errors * self._deviation
        flash_missed = self._flash - self._flash_light(self._pixels.view(outline), flash)
        spread = np.linalg.pinv(end.jac.T @ end.jac) * max(2 * end.cost / len(end.fun), 1e-12)
        variances = _turned_variances(frames, steps, spread[_COMMON:, _COMMON:])
        with np.errstate(divide="ignore", invalid="ignore"):  # no light has no relative misfit
            return SphereFit(
                directions=towards,
                colours=colours,
                deviations_deg=np.degrees(np.sqrt(variances)),
                moved=outline,
                flash_aside_deg=float(np.degrees(np.arctan(np.hypot(*flash[:2])))),
                cost=float(end.cost / lamp_errors.size),
                misfit=float(np.sqrt(np.mean(missed**2)) / self._light.mean()),
                flash_misfit=float(np.sqrt(np.mean(flash_missed**2)) / abs(self._flash.mean())),
            )

    def _flash_light(self, view: SphereView, flash: Floats64) -> Floats64:
        """Light (n,) of a flash in the plane of the lens on an even sphere."""
        to_flash = view.towards * view.distance[:, None]
        to_flash = to_flash + np.array([flash[0], flash[1], 0.0])
        fall_off = np.linalg.norm(to_flash, axis=1) ** 3
        facing = np.maximum((view.normals * to_flash).sum(axis=1), 0.02)
        return np.asarray(self._power * np.exp(flash[2]) * facing / fall_off)

    def _lamp_errors(
        self, view: SphereView, flash: Floats64, towards: Floats64
    ) -> tuple[Floats64, Floats64]:
        """Errors (n, 3) by their deviations under lamps of the best colours, and those (N, 3)."""
        albedo = self._flash / self._flash_light(view, flash)
        shading = np.maximum(view.normals @ towards.T, 0.0) * albedo[:, None]
        colours = [
            np.linalg.lstsq(shading / deviation[:, None], light / deviation, rcond=None)[0]
            for light, deviation in zip(self._light.T, self._deviation.T, strict=True)
        ]
        explained = shading @ np.array(colours).T
        return (explained - self._light) / self._deviation, np.array(colours).T

    def _errors(self, frames: Floats64, values: Floats64) -> Floats64:
        outline, flash, steps = np.split(values, [3, _COMMON])
        view = self._pixels.view(outline)
        lamps, _ = self._lamp_errors(view, flash, _turned(frames, steps))
        by_flash = (self._flash_light(view, flash) - self._flash) / self._flash_deviation
        prior = [outline / _MARK, flash[:2] / _ASIDE]
        return np.concatenate([lamps.ravel(), by_flash, *prior])


def _starts(problem: _Problem, count: int) -> list[Floats64]:
    """Sets of directions (count, 3) of a grid that explain the light best."""
    grid = _directions(_GRID)
    sets = np.array(list(combinations(range(len(grid)), count)))
    ranked = np.argsort(_explained(problem, grid, sets))[::-1]
    return [grid[sets[index]] for index in ranked[:_STARTS]]


def _with_another(problem: _Problem, directions: Floats64) -> Floats64:
    """Directions (N, 3), and that of a grid with which they explain the light best."""
    count = len(directions)
    candidates = np.concatenate([directions, _directions(_GRID)])
    sets = np.array([[*range(count), count + one] for one in range(_GRID)])
    best = sets[int(np.argmax(_explained(problem, candidates, sets)))]
    return np.asarray(candidates[best])


def _explained(problem: _Problem, directions: Floats64, sets: NDArray[np.int64]) -> Floats64:
    """How much of the light sets (n, N) of directions explain, −inf where one would be negative."""
    shading = np.maximum(problem.normals @ directions.T, 0.0) * problem.weight[:, None]
    light = problem.even * problem.weight[:, None]
    gram, moments = shading.T @ shading, shading.T @ light
    small = gram[sets[:, :, None], sets[:, None, :]]
    small = small + 1e-6 * np.eye(sets.shape[1]) * np.trace(gram) / len(directions)
    wanted = moments[sets]
    colours = np.linalg.solve(small, wanted)
    explained = (colours * wanted).sum(axis=(1, 2))
    strongest = np.abs(colours).max(axis=(1, 2), keepdims=True)
    negative = (colours < -0.05 * strongest).any(axis=(1, 2))
    return np.asarray(np.where(negative, -np.inf, explained))


def _directions(count: int) -> Floats64:
    """Directions (count, 3) spread evenly, from the viewer's to _BEHIND."""
    n = np.arange(count) + 0.5
    z = 1 - (1 + _BEHIND) * n / count
    angle = np.pi * (1 + 5**0.5) * n
    ring = np.sqrt(1 - z**2)
    return np.stack([ring * np.cos(angle), ring * np.sin(angle), z], axis=1)


def _turned(frames: Floats64, steps: Floats64) -> Floats64:
    """Directions (N, 3) of frames (N, 3, 3) after steps (2N,) across them."""
    across = np.einsum("jk,jkc->jc", steps.reshape(-1, 2), frames[:, 1:])
    return unit(frames[:, 0] + across)


def _turned_variances(frames: Floats64, steps: Floats64, spread: Floats64) -> Floats64:
    """Variances (N,), in radians squared, of `_turned` by that (2N, 2N) of the steps.

    A step far from where it began turns a direction by less than its length.
    """
    variances = []
    for at, (frame, step) in enumerate(zip(frames, steps.reshape(-1, 2), strict=True)):
        reached = frame[0] + step @ frame[1:]
        length = np.linalg.norm(reached)
        across = frame[1:] - np.outer(frame[1:] @ reached, reached) / length**2
        own = spread[2 * at : 2 * at + 2, 2 * at : 2 * at + 2]
        variances.append(np.trace(across.T @ own @ across) / length**2)
    return np.array(variances)


def _frame(direction: Floats64) -> Floats64:
    """A direction and two units across it, (3, 3)."""
    helper = np.eye(3)[int(np.argmin(np.abs(direction)))]
    side = unit(np.cross(direction, helper))
    return np.array([direction, side, np.cross(direction, side)])

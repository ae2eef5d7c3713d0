"""The invariants and the lamps found, drawn so that a person sees why.

Every pixel of the reduced pair is a direction on the sphere; seen from its middle (gnomonic
projection) the light of one lamp is a spot, of two a line, of three a triangle.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats64
from pipeline.colour.spaces import XYZ_TO_SRGB
from pipeline.encode.jpeg import to_srgb8
from pipeline.hui2018.invariant import light_coefficients
from pipeline.hui2018.projection import to_plane
from pipeline.images.frames import Matrix
from pipeline.lamps.lamps import Lamps
from pipeline.light.model import Model
from pipeline.pair.reduced import ReducedPair
from pipeline.pictures.lettering import (
    BACKGROUND,
    INK,
    Picture,
    box_of,
    overlap,
    panel,
    write,
    write_boxed,
)
from pipeline.vectors import unit

SIDE, LEGEND = 900, 150
"""Of the diagram, which is square, and of the legend below it, in pixels."""

_MARGIN = 110
_CELL = 3  # side of a bin of the histogram in pixels
_FAINTEST = 0.3  # strength of a bin with a single pixel
_FULLEST = 0.995  # of the bins; fuller ones, such as an even wall, look alike
_PRUNED = (125, 80, 215)
_LINES = (150, 150, 150)
_SMALLEST_VIEW = 0.12  # in the tangent plane: noise is not blown up to fill the picture
_RADIUS = 15
_LABEL_STEP = 19  # pixels, two of which are between a circle's middle and its label's
_SCALES_DEGREES = (20, 10, 5, 2, 1)


@dataclass(frozen=True)
class _View:
    """What is seen: middle (2,) of the tangent plane, pixels per unit of it, rotation to it."""

    middle: Floats64
    scale: float
    rotation: Matrix

    def place(self, plane: Floats64) -> NDArray[np.int64]:
        """Pixel (x, y) of points (n, 2) of the tangent plane."""
        offset = (plane - self.middle) * self.scale * (1, -1)
        return np.asarray(np.round(offset + SIDE / 2), dtype=np.int64)

    def histogram(self, gammas: Floats64) -> NDArray[np.int64]:
        """Invariants (n, 3) in each bin of the view."""
        at = self.place(to_plane(gammas, self.rotation[2])[0])
        at = at[((at >= 0) & (at < SIDE)).all(axis=1)] // _CELL
        cells = SIDE // _CELL
        flat = at[:, 1] * cells + at[:, 0]
        return np.bincount(flat, minlength=cells * cells).reshape(cells, cells)

    def directions(self) -> Floats64:
        """Direction (cells, cells, 3) of each bin's middle."""
        axis = (np.arange(SIDE // _CELL) * _CELL + (_CELL - SIDE) / 2) / self.scale
        x, y = np.meshgrid(axis + self.middle[0], self.middle[1] - axis)
        return unit(np.stack([x, y, np.ones_like(x)], axis=-1)) @ self.rotation


def draw_gamma_diagram(
    reduced: ReducedPair, lamps: Lamps, model: Model, labels: list[str]
) -> Picture:
    """8-bit sRGB picture (SIDE + LEGEND, SIDE, 3) of the invariants and the lamps in their colours.

    The histogram's bins have the colour of their light, brighter the more pixels there are
    (logarithmic), or violet where all of them were pruned before the lamps were found.
    labels: one line of text for each lamp.
    """
    usable = reduced.usable
    gammas = unit(light_coefficients(reduced.no_flash[usable], reduced.flash[usable], model.tensor))
    view = _look_at(lamps)
    everything, kept = view.histogram(gammas), view.histogram(lamps.invariants)
    colours = _colours(view.directions(), model.camera_to_xyz)
    colours[(everything > 0) & (kept == 0)] = _PRUNED
    most = max(int(np.quantile(everything[everything > 0], _FULLEST)), 2) if len(gammas) else 2
    bins = _shaded(colours, everything.astype(np.float64), most)
    picture = panel(SIDE + LEGEND, SIDE)
    picture[:SIDE] = bins.repeat(_CELL, axis=0).repeat(_CELL, axis=1)
    _draw_lamps(picture, view, lamps, model, labels)
    write(picture, "Colour of the light in every pixel, surfaces taken out", (24, 36))
    _draw_scale(picture, view.scale)
    _draw_legend(picture, most, len(lamps), 1.0 - len(lamps.invariants) / max(len(gammas), 1))
    return picture


def _look_at(lamps: Lamps) -> _View:
    """A view with all lamps and nearly all invariants that were kept in it."""
    center = unit(lamps.invariants.mean(axis=0))
    points, rotation = to_plane(lamps.invariants, center)
    corners, _ = to_plane(np.concatenate([lamps.coefficients, center[None]]), center)
    inner = np.quantile(points, [0.002, 0.998], axis=0)
    low, high = (f(np.vstack([inner, corners]), axis=0) for f in (np.min, np.max))
    half = max(float((high - low).max()) / 2, _SMALLEST_VIEW)
    return _View((low + high) / 2, (SIDE / 2 - _MARGIN) / half, rotation)


def _shaded(colours: NDArray[np.uint8], count: Floats64, most: int) -> Picture:
    """Colours over the background, as strong as the logarithm of the count, none for none."""
    strength = _FAINTEST + (1 - _FAINTEST) * np.log(np.maximum(count, 1)) / np.log(most)
    strength = np.where(count > 0, np.minimum(strength, 1.0), 0.0)[..., None]
    return np.asarray(np.round(strength * colours + (1 - strength) * BACKGROUND), np.uint8)


def _draw_lamps(
    picture: Picture, view: _View, lamps: Lamps, model: Model, labels: list[str]
) -> None:
    rotated = lamps.coefficients @ view.rotation.T
    placed = view.place(rotated[:, :2] / np.maximum(rotated[:, 2:], 1e-3))
    cv2.polylines(
        picture, [placed.reshape(-1, 1, 2).astype(np.int32)], True, _LINES, 1, cv2.LINE_AA
    )
    colours = _colours(lamps.coefficients, model.camera_to_xyz)
    numbered = zip(placed.tolist(), colours.tolist(), strict=True)
    for number, (at, colour) in enumerate(numbered, start=1):
        cv2.circle(picture, at, _RADIUS, colour, -1, cv2.LINE_AA)
        cv2.circle(picture, at, _RADIUS, INK, 2, cv2.LINE_AA)
        write(picture, str(number), (at[0] - 5, at[1] + 7), colour=BACKGROUND)
    _draw_labels(picture, placed.tolist(), labels)


def _draw_labels(picture: Picture, places: list[list[int]], labels: list[str]) -> None:
    """Beside the circles, towards the middle, so far off that none hides another or a circle."""
    taken = [(x - _RADIUS, y - _RADIUS, x + _RADIUS, y + _RADIUS) for x, y in places]
    for (x, y), label in zip(places, labels, strict=True):
        step = -_LABEL_STEP if y > SIDE // 2 else _LABEL_STEP
        y += 2 * step
        while any(overlap(box_of(label, (x, y), SIDE), one) for one in taken):
            y += step
        taken.append(box_of(label, (x, y), SIDE))
        write_boxed(picture, label, (x, y), SIDE)


def _draw_scale(picture: Picture, scale: float) -> None:
    """A bar of whole degrees at the lower right; true in the middle of the view."""
    degrees = next(
        (d for d in _SCALES_DEGREES if np.tan(np.radians(d)) * scale < SIDE / 4),
        _SCALES_DEGREES[-1],
    )
    length = round(float(np.tan(np.radians(degrees))) * scale)
    right, y = SIDE - 24, SIDE - 20
    cv2.line(picture, (right - length, y), (right, y), INK, 2)
    for x in (right - length, right):
        cv2.line(picture, (x, y - 6), (x, y + 6), INK, 2)
    write_boxed(picture, f"{degrees}°", (right - length // 2, y - 16), SIDE)


def _draw_legend(picture: Picture, most: int, lamps: int, pruned: float) -> None:
    """What the colours and signs mean, in words."""
    left, text, y = 24, 250, SIDE + 30
    counts = np.geomspace(1, most, 200) * np.ones((14, 1))
    ramp = _shaded(np.full((14, 200, 3), 255, np.uint8), counts, most)
    picture[y - 12 : y + 2, left : left + 200] = ramp
    write(picture, f"from 1 to {most} pixels or more with light of this colour", (text, y))
    y += 36
    cv2.rectangle(picture, (left, y - 12), (left + 200, y + 2), _PRUNED, -1)
    write(picture, f"pruned: {pruned:.1%} of the pixels, too few of a kind", (text, y))
    y += 36
    cv2.circle(picture, (left + 100, y - 5), 11, INK, 2, cv2.LINE_AA)
    between = {
        1: "the lamp found; all light should lie close to it",
        2: "the lamps found; light of both lies on the line between them",
        3: "the lamps found; light of all lies in the triangle between them",
    }
    write(picture, between[lamps], (text, y))


def _colours(gammas: Floats64, camera_to_xyz: Matrix) -> NDArray[np.uint8]:
    """sRGB code values (..., 3) of lights, each as bright as it can be shown."""
    linear = np.maximum(gammas, 0.0) @ (XYZ_TO_SRGB @ camera_to_xyz).T
    peak = linear.max(axis=-1, keepdims=True)
    shown = np.maximum(linear / np.where(peak > 0, peak, 1.0), 0.0).astype(np.float32)
    return to_srgb8(shown.reshape(-1, 1, 3)).reshape(shown.shape)

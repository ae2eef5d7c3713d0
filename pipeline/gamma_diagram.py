"""The invariants and the lamps found, drawn so that a person sees why.

Every pixel of the reduced pair is a direction on the sphere; seen from its middle (gnomonic
projection) the light of one lamp is a spot, of two a line, of three a triangle.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.colour.spaces import XYZ_TO_SRGB
from pipeline.encode.jpeg import to_srgb8
from pipeline.frames import Matrix
from pipeline.hui2018.lamps import to_plane, unit
from pipeline.lamps import Lamps

_SIDE = 900
_MARGIN = 110
_BACKGROUND, _INK = (28, 28, 30), (235, 235, 235)
_SMALLEST_VIEW = 0.12  # in the tangent plane: noise is not blown up to fill the picture
_SHADES = 6.0
_FONT = cv2.FONT_HERSHEY_SIMPLEX


def draw_gamma_diagram(lamps: Lamps, camera_to_xyz: Matrix, labels: list[str]) -> NDArray[np.uint8]:
    """8-bit sRGB picture (900, 900, 3) of the invariants in their own colours and of the lamps.

    labels: one line of ASCII text for each lamp.
    """
    center = unit(lamps.invariants.mean(axis=0))
    points, rotation = to_plane(lamps.invariants, center)
    corners, _ = to_plane(np.concatenate([lamps.coefficients, center[None]]), center)
    inner = np.quantile(points, [0.002, 0.998], axis=0)
    low, high = (f(np.vstack([inner, corners]), axis=0) for f in (np.min, np.max))
    half = max(float((high - low).max()) / 2, _SMALLEST_VIEW)
    scale = (_SIDE / 2 - _MARGIN) / half
    middle = (low + high) / 2

    def place(plane: NDArray[np.float64]) -> NDArray[np.int64]:
        offset = (plane - middle) * scale * (1, -1)
        return np.asarray(np.round(offset + _SIDE / 2), dtype=np.int64)

    axis = (np.arange(_SIDE) - _SIDE / 2) / scale
    x, y = np.meshgrid(axis + middle[0], middle[1] - axis)
    gammas = unit(np.stack([x, y, np.ones_like(x)], axis=-1)) @ rotation
    picture = _cloud(place(points), _colours(gammas, camera_to_xyz))
    placed = place(_projected(lamps, rotation))
    outline = placed.reshape(-1, 1, 2).astype(np.int32)
    cv2.polylines(picture, [outline], True, (120, 120, 120), 1, cv2.LINE_AA)
    colours = _colours(lamps.coefficients, camera_to_xyz)
    for at, colour, label in zip(placed.tolist(), colours.tolist(), labels, strict=True):
        cv2.circle(picture, at, 15, colour, -1, cv2.LINE_AA)
        cv2.circle(picture, at, 15, _INK, 2, cv2.LINE_AA)
        _write(picture, label, at)
    title = "Colour of the light in every pixel, surfaces taken out"
    cv2.putText(picture, title, (24, 36), _FONT, 0.62, _INK, 1, cv2.LINE_AA)
    return picture


def _projected(lamps: Lamps, rotation: Matrix) -> NDArray[np.float64]:
    rotated = lamps.coefficients @ rotation.T
    return np.asarray(rotated[:, :2] / np.maximum(rotated[:, 2:], 1e-3))


def _cloud(at: NDArray[np.int64], colours: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Points in the colour of their place, brighter where there are more of them."""
    inside = ((at >= 0) & (at < _SIDE)).all(axis=1)
    flat = at[inside, 1] * _SIDE + at[inside, 0]
    count = np.bincount(flat, minlength=_SIDE * _SIDE).reshape(_SIDE, _SIDE).astype(np.float32)
    count = np.asarray(cv2.GaussianBlur(count, (0, 0), 1.2), dtype=np.float32)
    strength = np.log1p(_SHADES * count / max(float(np.quantile(count[count > 0], 0.9)), 1e-6))
    strength = np.minimum(strength / np.log1p(_SHADES), 1.0)[..., None]
    background = np.array(_BACKGROUND, dtype=np.float32)
    return np.asarray(np.round(strength * colours + (1 - strength) * background), np.uint8)


def _colours(gammas: NDArray[np.float64], camera_to_xyz: Matrix) -> NDArray[np.uint8]:
    """sRGB code values (..., 3) of lights, each as bright as it can be shown."""
    linear = np.maximum(gammas, 0.0) @ (XYZ_TO_SRGB @ camera_to_xyz).T
    peak = linear.max(axis=-1, keepdims=True)
    shown = np.maximum(linear / np.where(peak > 0, peak, 1.0), 0.0).astype(np.float32)
    return to_srgb8(shown.reshape(-1, 1, 3)).reshape(shown.shape)


def _write(picture: NDArray[np.uint8], text: str, at: list[int]) -> None:
    (width, height), _ = cv2.getTextSize(text, _FONT, 0.6, 1)
    x = min(max(at[0] - width // 2, 8), _SIDE - width - 8)
    y = at[1] - 26 if at[1] > _SIDE // 2 else at[1] + 34 + height // 2
    cv2.putText(picture, text, (x, y), _FONT, 0.6, _BACKGROUND, 4, cv2.LINE_AA)
    cv2.putText(picture, text, (x, y), _FONT, 0.6, _INK, 1, cv2.LINE_AA)

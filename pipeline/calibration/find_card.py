"""Finds a grey card in a pair: four sides, one colour, and that of a flash on grey."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.calibration.flash import FAMILY
from pipeline.calibration.quads import find_quads, on_screen
from pipeline.options import Circle
from pipeline.spectra.lights import find_light
from pipeline.vectors import unit

Array = NDArray[np.float64]

_LONG_SIDE = 800
_AREAS = (0.005, 0.9)  # by that of the picture
_WITHIN = 0.7  # of the way from the middle to the nearest side: the circle that is read
_GREY_DEG = 4.0  # between its colour and that of a flash on grey
_EVEN = 0.05  # relative variation of brightness after a tilt of the light is taken out


def find_cards(flash: NDArray[np.floating], sensitivities: Array) -> list[Circle]:
    """Find circles that lie on grey cards, the largest first.

    flash: linear light (H, W, 3) of the flash alone. sensitivities: (3, W) of the camera. What is
    as grey as a card, a sheet of paper for one, does as well as one.
    """
    height, width = flash.shape[:2]
    scale = min(1.0, _LONG_SIDE / max(height, width))
    size = (round(width * scale), round(height * scale))
    whole = np.ascontiguousarray(flash, np.float32)
    light = cv2.resize(whole, size, interpolation=cv2.INTER_AREA).astype(np.float32, copy=False)
    white = unit(np.array([sensitivities @ find_light(name) for name in FAMILY]))
    found = []
    for quad in find_quads(on_screen(light), _AREAS):
        outline = quad.corners.astype(np.float32)
        x, y = quad.middle
        radius = _WITHIN * cv2.pointPolygonTest(outline, (float(x), float(y)), True)
        circle = Circle(x=float(x), y=float(y), radius=max(float(radius), 1.0))
        if _is_grey(light, circle, white):
            found.append(circle)
    found.sort(key=lambda circle: -circle.radius)
    apart: list[Circle] = []
    for one in found:  # what lies within a larger one is a part of it
        if all(np.hypot(one.x - o.x, one.y - o.y) > o.radius + one.radius for o in apart):
            apart.append(one)
    return [Circle(x=c.x / scale, y=c.y / scale, radius=c.radius / scale) for c in apart]


def _is_grey(light: NDArray[np.float32], circle: Circle, white: Array) -> bool:
    height, width = light.shape[:2]
    y, x = np.mgrid[:height, :width] + 0.5
    inside = np.hypot(x - circle.x, y - circle.y) <= circle.radius
    if inside.sum() < 20:
        return False
    values = light[inside].astype(np.float64)
    colour = unit(np.median(values, axis=0))
    if np.degrees(np.arccos(np.clip(white @ colour, -1, 1))).min() > _GREY_DEG:
        return False
    bright = values.sum(axis=1)
    plane = np.stack([np.ones_like(bright), x[inside], y[inside]], axis=1)
    left = bright - plane @ np.linalg.lstsq(plane, bright, rcond=None)[0]
    return bool(1.48 * np.median(np.abs(left)) < _EVEN * bright.mean())

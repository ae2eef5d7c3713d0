"""Four-sided areas of one colour in a picture: what patches of charts look like."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats64

_AREAS = (1e-4, 0.035)  # of a patch, by that of the picture
_WINDOWS = (0.03, 0.08, 0.2)  # of the long side, about which a pixel counts as bright or dark
_STEP = 6  # of 255, by which it must be so
_CANNY = ((20, 60), (60, 160))  # thresholds for faint edges and for strong ones
_ROUGH = 0.05  # of the outline's length, by which it may miss four straight sides
_FULL = 0.9  # least share that the outline's area has of its hull
_SAME = 0.4  # of a side: nearer middles are those of the same area


@dataclass(frozen=True)
class Quad:
    """corners: (4, 2) in pixels, around. middle: (2,), where the diagonals cross.

    side: that of a square of its area, in pixels.
    """

    corners: Floats64
    middle: Floats64
    side: float


def find_quads(screen: NDArray[np.uint8]) -> list[Quad]:
    """Find four-sided areas as large as a chart's patches in a picture (H, W)."""
    height, width = screen.shape[:2]
    low, high = (share * height * width for share in _AREAS)
    found: list[Quad] = []
    for mask in _masks(screen):
        contours, _ = cv2.findContours(mask, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
        for contour in contours:
            area = cv2.contourArea(contour)
            if low <= area <= high and (quad := _quad(np.asarray(contour, np.int32), area)):
                found.append(quad)
    return _different(found)


def _masks(screen: NDArray[np.uint8]) -> list[NDArray[np.uint8]]:
    masks = []
    longest = max(screen.shape[:2])
    planes = [screen.max(axis=2), *cv2.split(screen)]
    for plane in planes:
        for share in _WINDOWS:
            window = int(share * longest) | 1
            bright = cv2.adaptiveThreshold(
                plane, 255, cv2.ADAPTIVE_THRESH_MEAN_C, cv2.THRESH_BINARY, window, -_STEP
            )
            masks.append(cv2.morphologyEx(bright, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)))
    smooth = cv2.bilateralFilter(screen, 5, 25, 5)
    for low, high in _CANNY:
        edges = np.maximum.reduce([cv2.Canny(plane, low, high) for plane in cv2.split(smooth)])
        masks.append(255 - cv2.dilate(edges, np.ones((3, 3), np.uint8)))
    return [np.asarray(mask, np.uint8) for mask in masks]


def _quad(contour: NDArray[np.int32], area: float) -> Quad | None:
    hull = cv2.convexHull(contour)
    length = cv2.arcLength(hull, True)
    if area < _FULL * cv2.contourArea(hull):
        return None
    corners = cv2.approxPolyDP(hull, _ROUGH * length, True)[:, 0].astype(np.float64) + 0.5
    if len(corners) != 4 or cv2.contourArea(corners.astype(np.float32)) < _FULL * area:
        return None
    sides = np.linalg.norm(corners - np.roll(corners, -1, axis=0), axis=1)
    if sides.min() < 0.3 * sides.max():
        return None
    return Quad(corners, _crossing(corners), float(np.sqrt(area)))


def _crossing(corners: Floats64) -> Floats64:
    a, b, c, d = corners
    along = np.linalg.solve(np.stack([c - a, b - d], axis=1), b - a)
    return np.asarray(a + along[0] * (c - a))


def _different(quads: list[Quad]) -> list[Quad]:
    """One of those that several masks show: median middle and side, the corners of that side."""
    groups: list[list[Quad]] = []
    middles = np.empty((0, 3))
    for quad in quads:
        if len(groups):
            apart = np.hypot(*(middles[:, :2] - quad.middle).T) / quad.side
            alike = np.abs(np.log(middles[:, 2] / quad.side))
            near = np.flatnonzero((apart < _SAME) & (alike < 0.35))
            if len(near):
                groups[near[np.argmin(apart[near])]].append(quad)
                continue
        groups.append([quad])
        middles = np.vstack([middles, [*quad.middle, quad.side]])
    return [
        Quad(
            sorted(group, key=lambda quad: quad.side)[len(group) // 2].corners,
            np.median([quad.middle for quad in group], axis=0),
            float(np.median([quad.side for quad in group])),
        )
        for group in groups
    ]

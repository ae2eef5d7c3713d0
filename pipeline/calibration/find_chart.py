"""Finds a ColorChecker in a pair: patches that lie in a grid, and have its colours there."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats, Floats32, Floats64
from pipeline.calibration.chart_layout import CORNERS, PLACES, colour_misfit
from pipeline.calibration.marks import on_screen
from pipeline.calibration.quads import Quad, find_quads
from pipeline.spectra.colorchecker import COLUMNS, ROWS

_LONG_SIDE = 1200  # pixels of the picture in which patches are looked for
_LEAST = 8  # patches that must show as areas of their own
_NEXT = (0.9, 1.6)  # distance of neighbouring patches by their side
_BESIDE = 0.3  # of that distance, by which a neighbour may be beside its place
_NEAR = 0.2  # of a patch's pitch: so far its area may be from where the grid has it
_LIKE = 0.22  # relative error of any 3 × 3 matrix from XYZ to the patches' light
_UNLIKE = 0.5  # the same of areas as they were grown, some astray: tiles and chequers have more
_MOSTLY = 0.8  # of the areas that a chart could hold of those in a row
_TURNS = np.array([[(1, 0), (0, 1)], [(0, 1), (-1, 0)], [(-1, 0), (0, -1)], [(0, -1), (1, 0)]])


@dataclass(frozen=True)
class FoundChart:
    """corners: (4, 2) middles of dark skin, bluish green, black and white, in pixels.

    misfit: relative error of the patches' colours. patches: how many showed by themselves.
    """

    corners: Floats64
    misfit: float
    patches: int


def find_charts(light: Floats) -> list[FoundChart]:
    """Find all ColorCheckers in linear light (H, W, 3) of one colour, the likeliest first."""
    height, width = light.shape[:2]
    scale = _LONG_SIDE / max(height, width)
    size = (round(width * scale), round(height * scale))
    how = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    whole = np.ascontiguousarray(light, np.float32)
    resized = cv2.resize(whole, size, interpolation=how).astype(np.float32, copy=False)
    quads = find_quads(on_screen(resized))
    colours = _area_colours(resized, quads)
    found: list[FoundChart] = []
    for members in _lattices(quads):
        chart = _best_placed(resized, quads, colours, members)
        if chart and not any(_same(chart, other) for other in found):
            found.append(chart)
    found.sort(key=lambda chart: chart.misfit)
    return [FoundChart(one.corners / scale, one.misfit, one.patches) for one in found]


def _area_colours(light: Floats32, quads: list[Quad]) -> Floats64:
    """Mean light (n, 3) about the middles of areas."""
    colours = np.empty((len(quads), 3))
    for colour, quad in zip(colours, quads, strict=True):
        (x, y), reach = (quad.middle - 0.5).round().astype(int), max(1, int(0.15 * quad.side))
        about = light[max(y - reach, 0) : y + reach + 1, max(x - reach, 0) : x + reach + 1]
        colour[:] = about.mean(axis=(0, 1))
    return colours


def _lattices(quads: list[Quad]) -> list[dict[tuple[int, int], int]]:
    """Sets of areas that lie side by side: place in a grid → index, the largest sets first."""
    if len(quads) < _LEAST:
        return []
    middles = np.array([quad.middle for quad in quads])
    sides = np.array([quad.side for quad in quads])
    lattices, used = [], set[int]()
    for seed in range(len(quads)):
        if seed in used:
            continue
        lattice = _grown(seed, quads, middles, sides)
        if len(lattice) >= _LEAST:
            used.update(lattice.values())
            lattices.append(lattice)
    return sorted(lattices, key=len, reverse=True)


def _grown(
    seed: int, quads: list[Quad], middles: Floats64, sides: Floats64
) -> dict[tuple[int, int], int]:
    """Grow a grid from an area, neighbour by neighbour, each by the sides of its own area."""
    places: dict[tuple[int, int], int] = {(0, 0): seed}
    steps = {(0, 0): _steps(quads[seed])}
    waiting = [(0, 0)]
    while waiting:
        place = waiting.pop(0)
        here = places[place]
        for column, row in ((1, 0), (0, 1), (-1, 0), (0, -1)):
            there = (place[0] + column, place[1] + row)
            if there in places or max(map(abs, there)) >= COLUMNS:
                continue
            step = column * steps[place][0] + row * steps[place][1]
            away = (middles - middles[here]) @ step / (step @ step)
            beside = np.linalg.norm(middles - middles[here] - away[:, None] * step, axis=1)
            fits = (away > _NEXT[0]) & (away < _NEXT[1])
            fits &= beside < _BESIDE * np.linalg.norm(step)
            fits &= np.abs(np.log(sides / sides[here])) < 0.4
            candidates = [index for index in np.flatnonzero(fits) if index not in places.values()]
            if not candidates:
                continue
            chosen = min(candidates, key=lambda index: beside[index] + abs(away[index] - 1.15))
            places[there] = int(chosen)
            steps[there] = _like(_steps(quads[chosen]), steps[place])
            waiting.append(there)
    return places


def _steps(quad: Quad) -> Floats64:
    """Two sides (2, 2) of an area, the second a right turn on from the first."""
    a, b, c, d = quad.corners
    first, second = (b - a + c - d) / 2, (d - a + c - b) / 2
    if first[0] * second[1] - first[1] * second[0] < 0:
        second = -second
    return np.array([first, second])


def _like(steps: Floats64, wanted: Floats64) -> Floats64:
    """The same two sides in the order and direction in which they are nearest to others."""
    first, second = steps
    turns = [np.array(two) for two in _quarter_turns(first, second)]
    return max(turns, key=lambda turned: float((turned * wanted).sum()))


def _quarter_turns(first: Floats64, second: Floats64) -> list[tuple[Floats64, Floats64]]:
    return [(first, second), (second, -first), (-first, -second), (-second, first)]


def _best_placed(
    light: Floats32,
    quads: list[Quad],
    colours: Floats64,
    members: dict[tuple[int, int], int],
) -> FoundChart | None:
    """The chart that holds many of these areas, and fits their colours best; None without one.

    colours: (n, 3) of all areas.
    """
    places = np.array(list(members))
    indices = np.array(list(members.values()))
    windows = []
    for turn in _TURNS:
        at = places @ turn.T
        low, high = at.min(axis=0), at.max(axis=0)
        for column in range(low[0] - COLUMNS + 2, high[0]):
            for row in range(low[1] - ROWS + 2, high[1]):
                own = at - (column, row)
                inside = ((own >= 0) & (own < (COLUMNS, ROWS))).all(axis=1)
                windows.append((own[inside], indices[inside]))
    most = max(len(held) for _, held in windows)
    middles = np.array([quad.middle for quad in quads])
    charts = [
        _chart(light, middles, own.astype(float), middles[held])
        for own, held in windows
        # homographies take milliseconds, and a wall of tiles has thousands of windows
        if len(held) >= max(_LEAST, _MOSTLY * most)
        and colour_misfit(colours[held], own @ (1, COLUMNS)) <= _UNLIKE
    ]
    return min(filter(None, charts), key=lambda chart: chart.misfit, default=None)


def _chart(
    light: Floats32, middles: Floats64, places: Floats64, points: Floats64
) -> FoundChart | None:
    """The chart with areas at these places of its grid, by all areas that lie where it has them."""
    to_picture, _ = cv2.findHomography(places, points, cv2.LMEDS)
    if to_picture is None or not np.isfinite(to_picture).all():
        return None
    for _ in range(2):
        grid = _through(to_picture, PLACES)
        pitch = float(
            np.linalg.norm(np.diff(grid.reshape(ROWS, COLUMNS, 2), axis=1), axis=2).mean()
        )
        apart = np.linalg.norm(middles - grid[:, None], axis=2)
        close = apart.min(axis=1) < _NEAR * pitch
        if close.sum() < _LEAST:
            return None
        better, _ = cv2.findHomography(
            PLACES[close], middles[apart.argmin(axis=1)[close]], cv2.LMEDS
        )
        if better is None:
            return None
        to_picture = better
    grid = _through(to_picture, PLACES)
    colours = _colours(light, grid, pitch)
    if colours is None:
        return None
    misfit = colour_misfit(colours)
    if misfit > _LIKE:
        return None
    return FoundChart(_through(to_picture, CORNERS), misfit, int(close.sum()))


def _through(homography: NDArray[np.integer | np.floating], points: Floats64) -> Floats64:
    return np.asarray(cv2.perspectiveTransform(points[None], homography)[0])


def _colours(light: Floats32, grid: Floats64, pitch: float) -> Floats64 | None:
    """Mean light (24, 3) about the middles of patches; None where the chart leaves the picture."""
    reach = max(1, int(0.15 * pitch))
    height, width = light.shape[:2]
    margin = 0.4 * pitch
    if (grid < margin).any() or (grid > np.array([width, height]) - margin).any():
        return None
    corners = np.round(grid - 0.5).astype(int)
    return np.array(
        [
            light[y - reach : y + reach + 1, x - reach : x + reach + 1].mean(axis=(0, 1))
            for x, y in corners
        ],
        np.float64,
    )


def _same(one: FoundChart, other: FoundChart) -> bool:
    apart = np.linalg.norm(one.corners.mean(axis=0) - other.corners.mean(axis=0))
    return bool(apart < 0.3 * np.linalg.norm(one.corners[0] - one.corners[2]))

"""Refines a motion by least squares on what flash and lamps leave alike: steps of reflectance.

Source: Lucas & Kanade 1981 in the compositional form of Baker & Matthews, "Lucas-Kanade 20 Years
On", IJCV 2004, with the robust weights of Holland & Welsch 1977 (Tukey's biweight).
"""

from __future__ import annotations

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.frames import Image
from pipeline.order import quantile

Plane = NDArray[np.float32]

_BLUR = 0.5
_LOCAL = 2.0  # what is smoother than this is light, not reflectance
_DARK = 0.01  # of the 95th percentile; the logarithm bends there
_TUKEY = 4.685  # standard deviations at which a difference counts for nothing
_MAD = 1.4826
_EDGES = 0.85  # quantile of the gradient above which pixels tell of motion
_ROUNDS = 12
_DONE_PX = 0.005
HOMOGRAPHY = np.eye(8)
SHIFT = HOMOGRAPHY[[2, 5]]
TURN = np.concatenate([SHIFT, [HOMOGRAPHY[1] - HOMOGRAPHY[3], HOMOGRAPHY[0] + HOMOGRAPHY[4]]])
"""Freedoms of a motion, rows of the upper eight entries of its matrix; TURN is a similarity."""

_LEVELS = 3
_SMALLEST = 48
_MARGIN = 6  # pixels at the border, where the local mean is one-sided


def log_detail(image: Image) -> Image:
    """Logarithm of (h, w, 3) linear values less its local mean: steps of reflectance.

    A step of reflectance is the same under any light, channel by channel, as far as the light is
    smooth; edges of shadows are not.
    """
    steps = np.asarray(cv2.GaussianBlur(np.maximum(image, 0.0), (0, 0), _BLUR), dtype=np.float32)
    for channel in range(3):
        bright = quantile(cv2.extractChannel(steps, channel), 0.95)
        steps[..., channel] += np.float32(_DARK * bright + 1e-9)
    np.log(steps, out=steps)
    steps -= cv2.GaussianBlur(steps, (0, 0), _LOCAL)
    return steps


def refine_motion(
    reference: Image, sample: Image, matrix: NDArray[np.float64], freedoms: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Refine a homography that is right within a pixel or two.

    reference, sample: (h, w, 3) from log_detail. matrix: (3, 3), from a reference pixel to the
    sample's. freedoms: (n, 8), what may change: SHIFT, TURN or HOMOGRAPHY. Returns the matrix
    given where the equations have no solution.
    """
    for level in range(_LEVELS - 1, 0, -1):
        if min(reference.shape[:2]) >> level < _SMALLEST:
            continue
        matrix = _at_level(reference, sample, matrix, freedoms, level)
    return _refined(reference, sample, matrix, freedoms)


def _at_level(
    reference: Image,
    sample: Image,
    matrix: NDArray[np.float64],
    freedoms: NDArray[np.float64],
    level: int,
) -> NDArray[np.float64]:
    """Refine on photographs of 1/2^level the size, where larger errors are mended."""
    size = (reference.shape[1] >> level, reference.shape[0] >> level)
    small = [
        np.asarray(cv2.resize(steps, size, interpolation=cv2.INTER_AREA), dtype=np.float32)
        for steps in (reference, sample)
    ]
    x, y = size[0] / reference.shape[1], size[1] / reference.shape[0]
    shrink = np.array([[x, 0, x / 2 - 0.5], [0, y, y / 2 - 0.5], [0, 0, 1]])
    enlarge = np.linalg.inv(shrink)
    found = _refined(small[0], small[1], shrink @ matrix @ enlarge, freedoms)
    return np.asarray(enlarge @ found @ shrink)


def _refined(
    reference: Image, sample: Image, matrix: NDArray[np.float64], freedoms: NDArray[np.float64]
) -> NDArray[np.float64]:
    height, width = reference.shape[:2]
    inside = np.zeros((height, width), dtype=np.bool_)
    inside[_MARGIN:-_MARGIN, _MARGIN:-_MARGIN] = True
    unit = max(width, height) / 2.0  # coordinates of order one keep the equations in balance
    to_unit = np.array(
        [[1 / unit, 0, -width / 2 / unit], [0, 1 / unit, -height / 2 / unit], [0, 0, 1]]
    )
    from_unit = np.linalg.inv(to_unit)
    found = matrix
    for _ in range(_ROUNDS):
        step = _step(reference, sample, found, inside, to_unit, freedoms)
        if step is None:
            return matrix
        found = found @ (from_unit @ step @ to_unit)
        found = found / found[2, 2]
        if unit * np.abs(step - np.eye(3)).max() < _DONE_PX:
            break
    return found


def _step(
    reference: Image,
    sample: Image,
    matrix: NDArray[np.float64],
    inside: NDArray[np.bool_],
    to_unit: NDArray[np.float64],
    freedoms: NDArray[np.float64],
) -> NDArray[np.float64] | None:
    """One round: the small motion, in unit coordinates, that takes away most of the difference."""
    height, width = inside.shape
    flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    warped = np.asarray(
        cv2.warpPerspective(sample, matrix, (width, height), flags=flags), np.float32
    )
    outside = cv2.warpPerspective(
        np.zeros((height, width), np.float32), matrix, (width, height), flags=flags, borderValue=1.0
    )
    used = inside & (cv2.dilate(outside, np.ones((3, 3), np.uint8)) == 0)
    normal, right = np.zeros((8, 8)), np.zeros(8)
    for channel in range(3):
        both, strength, of_used = _strengths(reference, warped, used, channel)
        if not of_used.size:
            return None
        # more than the quantile is more than the value below it
        below = int(_EDGES * (of_used.size - 1))
        least = np.partition(of_used, below)[below]
        places = np.flatnonzero((strength > least) & used.ravel())
        if len(places) < 50:
            return None
        first, second = (steps.reshape(-1, 3)[places, channel] for steps in (reference, warped))
        difference = first - second
        scale = _MAD * quantile(np.abs(difference), 0.5) + 1e-9
        _add_equations(both, places, difference, scale, to_unit, normal, right)
    try:
        solution = freedoms.T @ np.linalg.solve(freedoms @ normal @ freedoms.T, freedoms @ right)
    except np.linalg.LinAlgError:
        return None
    if not np.isfinite(solution).all():
        return None
    return np.asarray(np.eye(3) + np.append(solution, 0.0).reshape(3, 3))


def agreement(reference: Image, sample: Image, matrix: NDArray[np.float64]) -> float:
    """Correlation of the steps that two photographs share under a motion, −1…1."""
    height, width = reference.shape[:2]
    flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    warped = cv2.warpPerspective(sample, matrix, (width, height), flags=flags)
    covered = cv2.warpPerspective(
        np.ones((height, width), np.uint8), matrix, (width, height), flags=cv2.WARP_INVERSE_MAP
    )
    inside = cv2.erode(covered, np.ones((3, 3), np.uint8)) > 0
    first, second, shared = _products(reference, np.asarray(warped, np.float32), inside)
    return float(shared / max(np.sqrt(first * second), 1e-12))


@njit(cache=True)
def _strengths(
    reference: Image, warped: Image, used: NDArray[np.bool_], channel: int
) -> tuple[Plane, Plane, Plane]:
    """Mean of a channel (h, w), its squared gradients (h·w,), and those of the used pixels (n,)."""
    height, width = used.shape
    both = np.empty((height, width), np.float32)
    for y in range(height):
        for x in range(width):
            both[y, x] = np.float32(0.5) * (reference[y, x, channel] + warped[y, x, channel])
    strength = np.zeros((height, width), np.float32)
    of_used = np.empty(height * width, np.float32)
    count = 0
    for y in range(1, height - 1):
        for x in range(1, width - 1):
            gx, gy = _gradient(both, y, x)
            strength[y, x] = gx * gx + gy * gy
        for x in range(1, width - 1):
            of_used[count] = strength[y, x]
            count += used[y, x]
    return both, strength.ravel(), of_used[:count]


@njit(cache=True, inline="always")
def _gradient(plane: Plane, y: int, x: int) -> tuple[np.float32, np.float32]:
    """Sobel's."""
    two, scale = np.float32(2.0), np.float32(0.125)
    gx = plane[y - 1, x + 1] - plane[y - 1, x - 1] + two * (plane[y, x + 1] - plane[y, x - 1])
    gy = plane[y + 1, x - 1] - plane[y - 1, x - 1] + two * (plane[y + 1, x] - plane[y - 1, x])
    corner = plane[y + 1, x + 1]
    return (
        scale * (gx + (corner - plane[y + 1, x - 1])),
        scale * (gy + (corner - plane[y - 1, x + 1])),
    )


@njit(cache=True)
def _add_equations(
    both: Plane,
    places: NDArray[np.intp],
    difference: Plane,
    scale: float,
    to_unit: NDArray[np.float64],
    normal: NDArray[np.float64],
    right: NDArray[np.float64],
) -> None:
    """Add the equations of a channel's telling pixels, numbered row by row, to (8, 8) and (8,)."""
    width, unit = both.shape[1], to_unit[0, 0]
    row, sums = np.empty(9), np.zeros((8, 9))
    for i in range(len(places)):
        off = difference[i] / (_TUKEY * scale)
        weight = 1.0 - off * off
        if weight <= 0.0:
            continue
        weight *= weight / (scale * scale)
        v, u = places[i] // width, places[i] % width
        slope_x, slope_y = _gradient(both, v, u)
        gx, gy = slope_x / unit, slope_y / unit
        x, y = u * unit + to_unit[0, 2], v * unit + to_unit[1, 2]
        along = gx * x + gy * y
        row[0], row[1], row[2] = gx * x, gx * y, gx
        row[3], row[4], row[5] = gy * x, gy * y, gy
        row[6], row[7], row[8] = -along * x, -along * y, difference[i]
        for j in range(8):
            weighted = weight * row[j]
            for k in range(j, 9):
                sums[j, k] += weighted * row[k]
    for j in range(8):
        right[j] += sums[j, 8]
        for k in range(8):
            normal[j, k] += sums[min(j, k), max(j, k)]


@njit(cache=True)
def _products(
    reference: Image, warped: Image, inside: NDArray[np.bool_]
) -> tuple[float, float, float]:
    """Sums of squares of both, and of their products, inside."""
    height, width = inside.shape
    first, second, shared = 0.0, 0.0, 0.0
    for y in range(height):
        for x in range(width):
            if inside[y, x]:
                for k in range(3):
                    one, other = reference[y, x, k], warped[y, x, k]
                    first += one * one
                    second += other * other
                    shared += one * other
    return first, second, shared

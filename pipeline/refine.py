"""Refines a motion by least squares on what flash and lamps leave alike: steps of reflectance.

Source: Lucas & Kanade 1981 in the compositional form of Baker & Matthews, "Lucas-Kanade 20 Years
On", IJCV 2004, with the robust weights of Holland & Welsch 1977 (Tukey's biweight).
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Image

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
    smooth = cv2.GaussianBlur(np.maximum(image, 0.0), (0, 0), _BLUR)
    dark = _DARK * np.percentile(smooth.reshape(-1, 3), 95, axis=0) + 1e-9
    logarithm = np.log(smooth + dark.astype(np.float32))
    return np.asarray(logarithm - cv2.GaussianBlur(logarithm, (0, 0), _LOCAL), dtype=np.float32)


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
    warped = cv2.warpPerspective(sample, matrix, (width, height), flags=flags)
    outside = cv2.warpPerspective(
        np.zeros((height, width), np.float32), matrix, (width, height), flags=flags, borderValue=1.0
    )
    used = inside & (cv2.dilate(outside, np.ones((3, 3), np.uint8)) == 0)
    normal, right = np.zeros((8, 8)), np.zeros(8)
    unit = to_unit[0, 0]
    for channel in range(3):
        both = 0.5 * (reference[..., channel] + warped[..., channel])
        gx = cv2.Sobel(both, -1, 1, 0, scale=0.125) / unit
        gy = cv2.Sobel(both, -1, 0, 1, scale=0.125) / unit
        strength = np.hypot(gx, gy)
        if not used.any():
            return None
        telling = used & (strength > np.quantile(strength[used], _EDGES))
        y, x = np.nonzero(telling)
        if len(x) < 50:
            return None
        gx, gy = gx[telling], gy[telling]
        difference = (reference[..., channel] - warped[..., channel])[telling].astype(np.float64)
        scale = _MAD * np.median(np.abs(difference)) + 1e-9
        weight = np.square(np.maximum(1.0 - np.square(difference / (_TUKEY * scale)), 0.0))
        weight /= scale**2
        x, y = x * unit + to_unit[0, 2], y * unit + to_unit[1, 2]
        along = gx * x + gy * y
        jacobian = np.stack([gx * x, gx * y, gx, gy * x, gy * y, gy, -along * x, -along * y])
        weighted = jacobian * weight
        normal += weighted @ jacobian.T
        right += weighted @ difference
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
    first, second = reference[inside], warped[inside]
    norm = float(np.sqrt(np.square(first).sum() * np.square(second).sum()))
    return float((first * second).sum()) / max(norm, 1e-12)

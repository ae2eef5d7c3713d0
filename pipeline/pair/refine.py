"""Refines a motion by least squares on what flash and lamps leave alike: steps of reflectance.

Source: Lucas & Kanade 1981 in the compositional form of Baker & Matthews, "Lucas-Kanade 20 Years
On", IJCV 2004, with the robust weights of Holland & Welsch 1977 (Tukey's biweight) and the step
lengths of Barzilai & Borwein, "Two-Point Step Size Gradient Methods", IMA J. Numer. Anal. 1988.
"""

from __future__ import annotations

import cv2
import numpy as np

from pipeline.arrays import Floats64
from pipeline.images.frames import Image
from pipeline.images.quantiles import ENOUGH, quantile
from pipeline.pair.lucas_kanade import add_products, equations, sampled

Pyramid = list[Image]
"""Steps of a photograph, the largest first, each next one half as large."""

Products = Floats64
"""Sums (rows, columns, 3) over blocks: squares of either photograph's steps, and their products."""

_BLUR = 0.5  # pixels; what is finer is noise
_LOCAL = 2.0  # what is smoother than this is light, not reflectance
_DARK = 0.01  # of the 95th percentile; the logarithm bends there
_TUKEY = 4.685  # standard deviations at which a difference counts for nothing
_MAD = 1.4826  # a Gaussian's standard deviation by its median absolute deviation
_EDGES = 0.85  # quantile of the gradient above which pixels tell of motion
_FEW = 50  # pixels that still tell
_SAMPLED = 30_000  # pixels by which a round tells quantiles
_NEAR = (12, 0.05, cv2.INTER_LINEAR)  # rounds at most, last step in pixels, and interpolation
_EXACT = (2, 0.005, cv2.INTER_CUBIC)  # a third round changes less than photographs tell
_FARTHEST = 3.0  # times as far as a round would go alone
HOMOGRAPHY = np.eye(8)
SHIFT = HOMOGRAPHY[[2, 5]]
TURN = np.concatenate([SHIFT, [HOMOGRAPHY[1] - HOMOGRAPHY[3], HOMOGRAPHY[0] + HOMOGRAPHY[4]]])
"""Freedoms of a motion, rows of the upper eight entries of its matrix; TURN is a similarity."""

_LEVELS = 3
_LARGE = 800  # longer side
_SMALLEST = 48  # shorter side of a level of the pyramid
_BLOCKS = (6, 8)  # rows and columns of blocks in which photographs are compared
_STRONG = 0.01  # of the most telling block's squares: blocks with less tell nothing
_BAND, _BANDS_APART = 24, 3  # rows compared at a time, and of how many bands one
_MARGIN = 6  # pixels at the border, where the local mean is one-sided
_REACH = 3  # pixels that gradients of an interpolated picture reach


def log_detail(image: Image) -> Image:
    """Logarithm of (h, w, 3) linear values less its local mean: steps of reflectance.

    A step of reflectance is the same under any light, channel by channel, as far as the light is
    smooth; edges of shadows are not.
    """
    steps = np.asarray(cv2.GaussianBlur(np.maximum(image, 0.0), (0, 0), _BLUR), dtype=np.float32)
    step = max(1, len(image) * image.shape[1] // ENOUGH)
    bright = np.array([quantile(steps[::step, :, channel], 0.95) for channel in range(3)])
    _rows(steps)[:] += np.tile(np.float32(_DARK * bright + 1e-9), image.shape[1])
    cv2.log(steps, dst=steps)  # a tenth of NumPy's time
    steps -= cv2.GaussianBlur(steps, (0, 0), _LOCAL)
    return steps


def pyramid(steps: Image) -> Pyramid:
    """Steps (h, w, 3) in full, in half and in a quarter of the size, as far as that is enough."""
    height, width = steps.shape[:2]
    return [steps] + [
        np.asarray(
            cv2.resize(steps, (width >> level, height >> level), interpolation=cv2.INTER_AREA),
            dtype=np.float32,
        )
        for level in range(1, _LEVELS)
        if min(height, width) >> level >= _SMALLEST
    ]


def shrinking(size: tuple[int, int], full: tuple[int, int]) -> Floats64:
    """Matrix (3, 3) from pixels of a picture of full (width, height) to those of a smaller one."""
    x, y = size[0] / full[0], size[1] / full[1]
    # pixel centers: u = x·(t + ½) − ½
    return np.array([[x, 0, x / 2 - 0.5], [0, y, y / 2 - 0.5], [0, 0, 1]])


def refine_motion(
    reference: Pyramid, sample: Pyramid, matrix: Floats64, freedoms: Floats64
) -> Floats64:
    """Refine a homography that is right within a pixel or two, as far as comparing motions needs.

    reference, sample: from pyramid. matrix: (3, 3), from a reference pixel to the sample's, in
    full size. freedoms: (n, 8), what may change: SHIFT, TURN or HOMOGRAPHY. Large pictures count
    from half their size on. The last step is below 0.05 pixels: see finish_motion. Where the
    equations of a size have no solution, it changes nothing.
    """
    for level in range(len(reference) - 1, _finest(reference) - 1, -1):
        one, other = reference[level], sample[level]
        start = _at(reference, level, matrix)
        small = _refined(one, other, start, freedoms, *_NEAR)
        matrix = _from(reference, level, small)
    return np.asarray(matrix)


def finish_motion(
    reference: Pyramid, sample: Pyramid, matrix: Floats64, freedoms: Floats64
) -> Floats64:
    """Make what refine_motion found exact in full size."""
    return _refined(reference[0], sample[0], matrix, freedoms, *_EXACT)


def products(reference: Image, sample: Image, matrix: Floats64) -> Products:
    """Sums of squares of the steps of two photographs, and of their products, under a motion.

    Returns (6, 8, 3) of as many blocks of the picture. Large photographs are compared in bands of
    rows, a third of all.
    """
    height, width = reference.shape[:2]
    apart = _BAND * _BANDS_APART if max(height, width) > _LARGE else _BAND
    sums = np.zeros((*_BLOCKS, 3))
    for top in range(0, height, apart):
        rows = slice(top, min(top + _BAND, height))
        first, second = reference[rows], _warped(sample, matrix, cv2.INTER_CUBIC, rows)
        block = top * _BLOCKS[0] // height
        add_products(_rows(first), _rows(second), matrix, top, height, 1, sums[block])
    return sums


def agreement(found: Products) -> float:
    """Correlation of the steps that two photographs share under a motion, −1…1; of products."""
    return float(_correlations(found.sum(axis=(0, 1))))


def better_share(found: Products, other: Products) -> float:
    """Share 0…1 of the blocks with strong steps in which `found` agrees better than `other`.

    0 where no block has any.
    """
    better = _correlations(found) > _correlations(other)
    strength = np.minimum(other[..., 0], other[..., 1])
    tells = strength > _STRONG * strength.max()
    return float(better[tells].mean()) if tells.any() else 0.0


def _correlations(found: Products) -> Floats64:
    squares, other_squares, shared = np.moveaxis(found, -1, 0)
    return np.asarray(shared / np.maximum(np.sqrt(squares * other_squares), 1e-12))


def _finest(steps: Pyramid) -> int:
    return int(max(steps[0].shape) > _LARGE and len(steps) > 1)


def _at(steps: Pyramid, level: int, matrix: Floats64) -> Floats64:
    """Express a homography of full size in the pixels of a level."""
    shrink = shrinking(steps[level].shape[1::-1], steps[0].shape[1::-1])
    return np.asarray(shrink @ matrix @ np.linalg.inv(shrink))


def _from(steps: Pyramid, level: int, matrix: Floats64) -> Floats64:
    """Express a homography of a level in the pixels of full size."""
    shrink = shrinking(steps[level].shape[1::-1], steps[0].shape[1::-1])
    return np.asarray(np.linalg.inv(shrink) @ matrix @ shrink)


def _refined(
    reference: Image,
    sample: Image,
    matrix: Floats64,
    freedoms: Floats64,
    rounds: int,
    done_px: float,
    interpolation: int,
) -> Floats64:
    height, width = reference.shape[:2]
    unit = max(width, height) / 2.0  # coordinates of order one keep the equations in balance
    to_unit = np.array(
        [[1 / unit, 0, -width / 2 / unit], [0, 1 / unit, -height / 2 / unit], [0, 0, 1]]
    )
    from_unit = np.linalg.inv(to_unit)
    found, before, gone = matrix, np.zeros((3, 3)), np.zeros((3, 3))
    for _ in range(rounds):
        step = _step(reference, sample, found, to_unit, freedoms, interpolation)
        if step is None:
            return matrix
        change = step - np.eye(3)
        gone, before = _lengthened(change, before, gone), change
        found = found @ (from_unit @ (np.eye(3) + gone) @ to_unit)
        found = found / found[2, 2]
        if unit * np.abs(gone).max() < done_px:
            break
    return found


def _lengthened(change: Floats64, before: Floats64, gone: Floats64) -> Floats64:
    """How far to go by a round's change, told by the round before: its change, and how far it went.

    What else differs between the photographs makes every round go short, often by half: steeper
    gradients ask for less, and weights are those of where it starts.
    """
    if not gone.any():
        return change
    went, shrank = np.vdot(gone, gone), np.vdot(gone, before - change)
    return np.asarray(change * (went / max(shrank, went / _FARTHEST)))


def _step(
    reference: Image,
    sample: Image,
    matrix: Floats64,
    to_unit: Floats64,
    freedoms: Floats64,
    interpolation: int,
) -> Floats64 | None:
    """One round: the small motion, in unit coordinates, that takes away most of the difference."""
    first, second = _rows(reference), _rows(_warped(sample, matrix, interpolation))
    where = (matrix, _MARGIN, _REACH)
    strengths, differences = sampled(first, second, *where, max(1, first.size // (3 * _SAMPLED)))
    if strengths.shape[1] < _FEW:
        return None
    least, scales = np.empty((2, 3), np.float32)
    below = int(_EDGES * (strengths.shape[1] - 1))
    for channel, (strength, difference) in enumerate(zip(strengths, differences, strict=True)):
        # more than the quantile is more than the value below it
        least[channel] = np.partition(strength, below)[below]
        telling = np.abs(difference[strength > least[channel]])
        if len(telling) < _FEW:
            return None
        scales[channel] = _MAD * quantile(telling, 0.5) + 1e-9
    sums = equations(first, second, *where, least, np.float32(_TUKEY) * scales, to_unit)
    normal, right = sums[:, :8], sums[:, 8]
    try:
        solution = freedoms.T @ np.linalg.solve(freedoms @ normal @ freedoms.T, freedoms @ right)
    except np.linalg.LinAlgError:
        return None
    if not np.isfinite(solution).all():
        return None
    return np.asarray(np.eye(3) + np.append(solution, 0.0).reshape(3, 3))


def _warped(image: Image, matrix: Floats64, interpolation: int, rows: slice = slice(None)) -> Image:
    """Rows of a picture laid on another by a homography."""
    top, bottom, _ = rows.indices(len(image))
    if np.array_equal(matrix, np.eye(3)):
        return image[top:bottom]
    from_rows = matrix @ [[1, 0, 0], [0, 1, top], [0, 0, 1]]
    size, flags = (image.shape[1], bottom - top), interpolation | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpPerspective(image, from_rows, size, flags=flags), np.float32)


def _rows(image: Image) -> Image:
    """(h, w, 3) as (h, 3·w)."""
    return image.reshape(len(image), -1)

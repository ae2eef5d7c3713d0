"""Warp the flash frame onto the no-flash frame.

Source: phase correlation, Kuglin & Hines, "The Phase Correlation Image Alignment Method", 1975. It
runs on a normalised gradient image, because flash and no-flash pictures share edges, not
brightness, and on turns of it; least squares on steps of reflectance then make it exact. Edges are
compared by the enhanced correlation coefficient of Evangelidis & Psarakis, PAMI 2008.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np

from pipeline.arrays import Floats64
from pipeline.images.area_means import area_means, size_within
from pipeline.images.frames import Image, Mask, Photograph
from pipeline.images.memory import empty_image
from pipeline.images.quantiles import ENOUGH, quantile
from pipeline.pair.refine import (
    HOMOGRAPHY,
    SHIFT,
    TURN,
    Pyramid,
    agreement,
    better_share,
    finish_motion,
    log_detail,
    products,
    pyramid,
    refine_motion,
    shrinking,
)
from pipeline.threads import at_once

_LONG_SIDES = (1400, 800)  # the second for pairs whose noise drowns fine edges
_EDGES_LONG_SIDE = 800  # where edges are taken, and are to correlate
_SEARCH_SIZE = 400  # where they are searched for a motion that is then refined
_TURNS = (-3, -2, -1, 0, 1, 2, 3)  # degrees; more is no hand
_BACKWARDS = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
_LOCAL = 16.0  # pixels around, by whose mean an edge is divided
_LOCAL_SIZE = 4  # pixels averaged where the local mean is taken
_FIRST = 0.02  # what the first motion taken must gain in agreement; tripod pairs gain up to .018
_FIRST_PART = 0.12  # of the agreement, which noise lowers: a turn then need not gain more
_FIRST_ZOOM = 0.06  # the same of one that changes the size above all; docs/trials/alignment.md
_MOSTLY = 0.7  # share of the picture's blocks that must agree better
_PLAIN_PX = 1.0  # shadows are taken for shorter shifts; longer ones need to gain half as much
_MAX_BEND = 0.03  # of the diagonal, at a corner
_MIN_CORRELATION = 0.25  # related pairs reach 0.4 to 0.9, half of the unrelated ones 0.03
_MAX_MOTION = 0.15  # of the diagonal; a hand-held pair moves less


@dataclass(frozen=True)
class Alignment:
    """How the flash frame lies on the no-flash frame.

    applied: whether the flash frame was warped.
    matrix: (3, 3) homography from no-flash pixel (x, y, 1) to flash pixel; identity when refused.
    correlation: enhanced correlation coefficient reached, −1…1; None when not attempted.
    problem: one sentence when alignment was refused, else None.
    """

    applied: bool
    matrix: Floats64
    correlation: float | None
    problem: str | None = None


NOT_ATTEMPTED = Alignment(False, np.eye(3), None)


def estimate_alignment(no_flash: Photograph, flash: Photograph) -> Alignment:
    """Find the homography that lays the flash frame on the no-flash frame.

    no_flash, flash: (H, W, 3) linear, equal sizes. A result that cannot be trusted is refused
    (applied False, problem set), never returned as if it were right.
    """
    refused = NOT_ATTEMPTED
    for long_side in _LONG_SIDES:
        found = _attempt(no_flash, flash, long_side)
        if found.problem is None:
            return found
        refused = refused if refused.problem else found
    return refused


def _attempt(no_flash: Photograph, flash: Photograph, long_side: int) -> Alignment:
    height, width = no_flash.shape[:2]
    size = size_within((width, height), long_side)
    (reference, reference_steps), (sample, sample_steps) = at_once(
        partial(_reduced, size=size), (no_flash, flash)
    )
    try:
        small = _estimate(reference, sample, reference_steps, sample_steps)
        correlation = _correlation(reference, sample, _to_size(small, size, reference.shape[::-1]))
    except cv2.error:
        return _refused(None, "no common structure was found")
    if not np.isfinite(small).all() or not np.isfinite(correlation):
        return _refused(None, "no common structure was found")
    matrix = _to_size(small, size, (width, height))
    motion = _corner_motion(matrix, width, height)
    if correlation < _MIN_CORRELATION:
        return _refused(float(correlation), f"their edges correlate by only {correlation:.2f}")
    if motion > _MAX_MOTION * np.hypot(width, height):
        return _refused(float(correlation), f"a motion of {motion:.0f} pixels is implausible")
    return Alignment(not np.array_equal(small, np.eye(3)), matrix, float(correlation))


def _reduced(image: Photograph, size: tuple[int, int]) -> tuple[Image, Pyramid]:
    """Edges of a photograph, and its steps at (width, height)."""
    small = area_means(image, size)
    return edges(_shrunk(small, _EDGES_LONG_SIDE)), pyramid(log_detail(small))


def _shrunk(image: Image, longest: int) -> Image:
    """A picture with no side longer than that."""
    return area_means(image, size_within((image.shape[1], image.shape[0]), longest))


def _estimate(
    reference: Image, sample: Image, reference_steps: Pyramid, sample_steps: Pyramid
) -> Floats64:
    """Homography, in pixels of the steps, of the simplest motion that explains the photographs.

    reference, sample: edges; reference_steps, sample_steps: from pyramid. A richer motion must
    make the steps agree better, so that a pair from a tripod stays as it is: the homography of
    edges that flash and lamps draw differently is off by half a pixel at the corners.
    """
    found, chosen = np.eye(3), None
    height, width = reference_steps[0].shape[:2]
    known = products(reference_steps[0], sample_steps[0], found)
    best = agreement(known)
    small = _shrunk(reference, _SEARCH_SIZE), _shrunk(sample, _SEARCH_SIZE)
    for search, freedoms, worth_it in _MOTIONS:
        start = found
        if search is not None:
            start = _to_size(search(*small), small[0].shape[::-1], (width, height))
        candidate = refine_motion(reference_steps, sample_steps, start, freedoms)
        moves = _corner_motion(candidate @ np.linalg.inv(found), width, height)
        if search is None and moves > _MAX_BEND * np.hypot(width, height):
            continue
        there = products(reference_steps[0], sample_steps[0], candidate)
        if better_share(there, known) < _MOSTLY:
            continue  # a few strong edges of shadows move, the rest of the picture does not
        agrees = agreement(there)
        if search is _shift:
            worth_it = _FIRST / 2 if moves > _PLAIN_PX else _FIRST
        elif chosen is None:
            worth_it = min(_FIRST, _FIRST_PART * agrees)
            as_large = _unzoomed(candidate, width, height)
            there_as_large = products(reference_steps[0], sample_steps[0], as_large)
            if agreement(there_as_large) <= best + worth_it:
                worth_it = _FIRST_ZOOM
        if agrees > best + worth_it:
            found, chosen, known = candidate, freedoms, there
        best = max(best, agrees)
    if chosen is None:
        return found
    return finish_motion(reference_steps, sample_steps, found, chosen)


def _unzoomed(matrix: Floats64, width: int, height: int) -> Floats64:
    """A motion (3, 3) that leaves things in the middle of the picture as large as they are."""
    middle = np.array([width / 2, height / 2, 1.0])
    x, y, w = matrix @ middle
    slopes = (matrix[:2, :2] - np.outer([x / w, y / w], matrix[2, :2])) / w
    smaller = np.diag([1.0, 1.0, np.sqrt(np.abs(np.linalg.det(slopes)))])
    there = np.eye(3)
    there[:2, 2] = middle[:2]
    return np.asarray(matrix @ there @ smaller @ np.linalg.inv(there))


def _shift(reference: Image, sample: Image) -> Floats64:
    """Shift (3, 3) between edges, within a pixel or two of them, however far it goes."""
    window = cv2.createHanningWindow(reference.shape[::-1], cv2.CV_32F)
    (x, y), _ = cv2.phaseCorrelate(reference - reference.mean(), sample - sample.mean(), window)
    return np.array([[1.0, 0.0, x], [0.0, 1.0, y], [0.0, 0.0, 1.0]])


def _turn(reference: Image, sample: Image) -> Floats64:
    """Turn and shift (3, 3) between edges that correlates them best, within half a degree."""
    height, width = reference.shape
    middle = (width - 1) / 2, (height - 1) / 2
    found, best = np.eye(3), -1.0
    for degrees in _TURNS:
        rows = cv2.getRotationMatrix2D(middle, degrees, 1.0)
        turned = np.asarray(
            cv2.warpAffine(sample, rows, (width, height), flags=_BACKWARDS), np.float32
        )
        matrix = np.vstack([rows, [0.0, 0.0, 1.0]]) @ _shift(reference, turned)
        correlation = _correlation(reference, sample, matrix)
        if correlation > best:
            found, best = matrix, correlation
    return found


_MOTIONS = (  # where it is searched; what the refinement may change; what it must gain in agreement
    (_shift, SHIFT, _FIRST),
    (_turn, TURN, 0.006),
    (None, HOMOGRAPHY, 0.01),  # a search would bend it to shadows where there are few edges
)


def _correlation(reference: Image, sample: Image, matrix: Floats64) -> float:
    """Correlation of the edges where the warped sample covers the reference."""
    size = reference.shape[::-1]
    flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    warped = cv2.warpPerspective(sample, matrix, size, flags=flags)
    everywhere = np.full(reference.shape, 255, dtype=np.uint8)
    covered = cv2.warpPerspective(
        everywhere, matrix, size, flags=cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
    )
    return float(cv2.computeECC(reference, warped, covered))


def warp(image: Photograph, unusable: Mask, alignment: Alignment) -> tuple[Image, Mask]:
    """Resample the flash frame on the no-flash frame's pixels.

    Returns the warped (H, W, 3) image and the (H, W) mask of pixels that are unusable or have
    no counterpart.
    """
    height, width = unusable.shape
    flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    warped = empty_image(*image.shape)
    cv2.warpPerspective(
        image[:],
        alignment.matrix,
        (width, height),
        dst=warped,
        flags=flags,
        borderMode=cv2.BORDER_REPLICATE,  # black would reach into usable pixels
    )
    bad = cv2.warpPerspective(
        np.multiply(unusable, np.uint8(255)),
        alignment.matrix,
        (width, height),
        flags=_BACKWARDS,
        borderValue=255,
    )
    return warped, bad > 0


def edges(image: Image) -> Image:
    """Gradient magnitude of the brightness, divided by its own local mean and compressed."""
    gray = np.maximum(cv2.transform(image, np.full((1, 3), 1 / 3)), np.float32(0.0))
    bright = quantile(gray[:: max(1, gray.size // ENOUGH)], 0.95)
    gray = np.sqrt(gray / np.float32(max(bright, 1e-9)))
    gray = np.asarray(cv2.GaussianBlur(gray, (0, 0), 1.0), np.float32)
    slopes = cv2.Scharr(gray, -1, 1, 0), cv2.Scharr(gray, -1, 0, 1)
    magnitude = np.asarray(cv2.magnitude(*slopes), np.float32)
    local = _local_mean(magnitude)
    relative = magnitude / (local + 0.2 * local.mean() + 1e-9)
    return np.asarray(relative / (1.0 + relative / 2.0), dtype=np.float32)


def _local_mean(plane: Image) -> Image:
    """Mean of (h, w) around each pixel; so smooth that a quarter of the size holds it."""
    height, width = plane.shape
    size = (-(-width // _LOCAL_SIZE), -(-height // _LOCAL_SIZE))
    small = cv2.resize(plane, size, interpolation=cv2.INTER_AREA)
    smooth = cv2.GaussianBlur(small, (0, 0), _LOCAL / _LOCAL_SIZE)
    return np.asarray(cv2.resize(smooth, (width, height)), dtype=np.float32)


def _to_size(matrix: Floats64, size: tuple[int, int], other: tuple[int, int]) -> Floats64:
    """Express a homography of pictures of one (width, height) in the pixels of another."""
    back = shrinking(size, other)
    matrix = np.linalg.inv(back) @ matrix @ back
    return np.asarray(matrix / matrix[2, 2])


def _corner_motion(matrix: Floats64, width: int, height: int) -> float:
    """Largest displacement of the four corners, in pixels."""
    corners = np.array([[0, 0, 1], [width, 0, 1], [0, height, 1], [width, height, 1]], dtype=float)
    moved = corners @ matrix.T
    return float(np.linalg.norm(moved[:, :2] / moved[:, 2:] - corners[:, :2], axis=1).max())


def _refused(correlation: float | None, why: str) -> Alignment:
    problem = (
        f"The two photographs could not be aligned ({why}); they are used as they are, so edges "
        "may show wrong light. Use a tripod, or switch aligning off if they already fit "
        "(--no-align, or the option align: false)."
    )
    return Alignment(False, np.eye(3), correlation, problem)

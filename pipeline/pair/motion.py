"""Finds what one photograph shows and the other does not: things that moved, and uncovered ground.

Lamps and flash light the scene differently, so only what holds under any light is tested: the
flash adds light and takes none away, and edges add up, flash photograph = lamps + flash. An edge
of a surface, or of a lamp's shadow, is thus in the flash photograph as well, and never fainter
than without the flash; one that is gone has moved.
"""

from __future__ import annotations

from functools import partial

import cv2
import numpy as np

from pipeline.arrays import Floats32, Floats64
from pipeline.images.area_means import area_means
from pipeline.images.blocks import any_in_blocks, blocks_within
from pipeline.images.disc import disc
from pipeline.images.frames import Image, Mask, Photograph
from pipeline.images.noise import Noise
from pipeline.threads import at_once

_LONG_SIDE = 1000  # pixels at which motion is looked for
_SIGNIFICANT = 5.0  # standard deviations
_LOST = 0.08  # part of its light that a pixel must lose
_LOST_RENDERED = 0.25  # the same where a camera rendered the photographs, each in its own way
_STEP = 0.03  # of the brightness; fainter edges tell nothing
_GONE = 0.35  # part of an edge that may be left
_APPEARED = 0.3  # part of a step under the flash that may be there without it
_EVEN_FLASH = 0.35  # darker beside brighter flash light; less is the flash's shadow or its gloss
_NEAR = 9  # pixels, side of the square for "beside"
_POOL, _LEAST_POOL = 0.0075, 3.0  # of the diagonal; pixels: the blur that tells edges from pools
_BLURRED = 0.85  # part of its steepness that this blur may leave of an edge
_GRADIENT_NOISE = 0.06  # variance of a gradient after both blurs, relative to a pixel's
_EDGE_BLUR, _EDGE_WINDOW = 1.0, 1.5
_SPECK = 2e-4  # of the picture; less is chance
_SMALLEST = 12  # pixels
_REACH = 0.02  # of the diagonal: gaps between edges of one thing
_THIN = 0.006  # of the diagonal: half the width of what is a thing and no edge
_EVIDENCE = 0.02  # of a thing's area that must show in a way
_ALONE = 0.01  # of the picture
_CLIPPED_REACH = 7  # pixels around unusable ones, whose edges are no edges
_SUM = np.ones((1, 3), np.float32)  # over channels, as a matrix


def find_moved(
    no_flash: Photograph,
    flash: Photograph,
    unusable: Mask,
    noises: tuple[Noise, Noise],
    rendered: bool,
    brightened: float = 1.0,
) -> Mask:
    """Mark pixels whose two photographs show different things.

    no_flash, flash: (H, W, 3) linear, aligned, on one scale, the flash photograph with the lamps'
    light in it. unusable: (H, W), left out. noises: of each. rendered: a camera made them
    pictures, with a curve of its own. brightened: times which the flash photograph is taken.
    Returns bool (H, W).
    """
    height, width = unusable.shape
    blocks = blocks_within(width, height, _LONG_SIDE)
    means = at_once(partial(area_means, size=blocks.size, crop=blocks.crop), (no_flash, flash))
    before, after = (np.maximum(image, 0.0) for image in means)
    variances = [
        _variance(noise.of_means(blocks.side), image)
        for noise, image in zip(noises, (before, after), strict=True)
    ]
    after, variances[1] = after * np.float32(brightened), variances[1] * np.float32(brightened**2)
    out = any_in_blocks(unusable, blocks.side)
    reach = np.ones((_CLIPPED_REACH, _CLIPPED_REACH), np.uint8)
    usable = cv2.dilate(out.astype(np.uint8), reach) == 0

    lost = usable & _lost(before, after, variances, _LOST_RENDERED if rendered else _LOST)
    gone, appeared = (usable & edges for edges in _edges_that_differ(before, after, variances))
    appeared &= _evenly_lit(before, after)
    # a pool of the flash's light is wide, and takes none away
    appeared &= _sharp(after) | _losing(_things(lost | gone | appeared), lost)
    moved = _with_evidence(_things(lost | gone | appeared), lost, gone, appeared)
    found = np.zeros(unusable.shape, dtype=np.uint8)
    columns, rows = blocks.crop
    found[:rows, :columns] = cv2.resize(
        moved.astype(np.uint8), blocks.crop, interpolation=cv2.INTER_NEAREST
    )
    return found.view(np.bool_)


def _variance(noise: Noise, image: Image) -> Floats32:
    """What noise.variance gives for values ≥ 0, in single precision."""
    line = np.column_stack([np.diag(noise.gain), noise.floor])
    return np.asarray(cv2.transform(image, line.astype(np.float32)))


def _lost(before: Image, after: Image, variances: list[Floats32], least: float) -> Mask:
    """Pixels that are darker with the flash than everything around them without it."""
    around = cv2.erode(before, np.ones((3, 3), np.uint8))  # half a pixel of misalignment is none
    difference = cv2.GaussianBlur(after - around, (0, 0), _EDGE_BLUR)
    deviation = np.sqrt(variances[0] + variances[1])
    dark = (difference < -_SIGNIFICANT / 2 * deviation) & (difference < -least * before)
    return np.asarray(dark.any(axis=2))


def _edges_that_differ(before: Image, after: Image, variances: list[Floats32]) -> tuple[Mask, Mask]:
    """Edges that are gone with the flash, and edges that were not there without it."""
    first, second = _gradient(before), _gradient(after)
    own, other = _window(first, first), _window(second, second)
    shared = _window(first, second)
    noise, other_noise = (
        _SIGNIFICANT**2 * _GRADIENT_NOISE * _sum(variance) for variance in variances
    )
    level, other_level = _sum(before * before) + 1e-12, _sum(after * after) + 1e-12
    strong = (own > noise) & (own > other_noise) & (own > _STEP**2 * level)
    gone = strong & (np.abs(shared) < _GONE * own) & (other < own)
    step = other / other_level
    would_show = step * level > noise
    appeared = (other > other_noise) & (step > _STEP**2) & would_show
    appeared &= own / level < _APPEARED**2 * step
    return np.asarray(gone), np.asarray(appeared)


def _evenly_lit(before: Image, after: Image) -> Mask:
    """Pixels beside which the flash neither casts a shadow nor is mirrored."""
    flash = cv2.transform(np.maximum(after - before, 0.0), _SUM)
    square = np.ones((_NEAR, _NEAR), np.uint8)
    return np.asarray(cv2.erode(flash, square) > _EVEN_FLASH * cv2.dilate(flash, square))


def _sharp(after: Image) -> Mask:
    """Pixels beside edges that a wide blur flattens; it leaves pools of light as they are."""
    pool = max(_LEAST_POOL, _POOL * float(np.hypot(*after.shape[:2])))
    narrow, wide = (_gradient(after, blur) for blur in (_EDGE_BLUR, pool))
    square = np.ones((_NEAR, _NEAR), np.uint8)
    edges, flattened = (cv2.dilate(_window(one, one), square) for one in (narrow, wide))
    return np.asarray(flattened < _BLURRED**2 * edges)


def _gradient(image: Image, blur: float = _EDGE_BLUR) -> tuple[Floats32, Floats32]:
    smooth = cv2.GaussianBlur(image, (0, 0), blur)
    x, y = (cv2.Sobel(smooth, -1, 1 - axis, axis, scale=0.125) for axis in (0, 1))
    return np.asarray(x, dtype=np.float32), np.asarray(y, dtype=np.float32)


def _window(first: tuple[Floats32, Floats32], second: tuple[Floats32, Floats32]) -> Floats32:
    return _sum(first[0] * second[0] + first[1] * second[1])


def _sum(values: Floats32) -> Floats32:
    """Sum over channels and mean over a small window."""
    return np.asarray(cv2.GaussianBlur(cv2.transform(values, _SUM), (0, 0), _EDGE_WINDOW))


def _things(evidence: Mask) -> Mask:
    """Close the gaps between edges, fill what they enclose, and drop what stays as thin as one."""
    height, width = evidence.shape
    _, labels, stats, _ = cv2.connectedComponentsWithStats(evidence.astype(np.uint8))
    least = max(_SMALLEST, _SPECK * evidence.size)
    large = stats[:, cv2.CC_STAT_AREA] >= least
    large[0] = False  # the background
    if not large.any():
        return np.zeros_like(evidence)
    diagonal = float(np.hypot(height, width))
    reach, thin = (max(1, round(share * diagonal)) for share in (_REACH, _THIN))
    padded = np.pad(large[labels].astype(np.uint8), reach)
    closed = cv2.morphologyEx(padded, cv2.MORPH_CLOSE, disc(reach))
    outlines, _ = cv2.findContours(closed, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    filled = np.zeros_like(closed)
    cv2.drawContours(filled, outlines, -1, 1, cv2.FILLED)
    opened = cv2.morphologyEx(filled, cv2.MORPH_OPEN, disc(thin))
    return np.asarray(opened[reach:-reach, reach:-reach] > 0)


def _losing(things: Mask, lost: Mask) -> Mask:
    """Things of which some part has lost light."""
    count, labels = cv2.connectedComponents(things.astype(np.uint8))
    area = np.bincount(labels.ravel(), minlength=count)
    losing = np.bincount(labels[lost], minlength=count) > _EVIDENCE * area
    losing[0] = False  # the background
    return np.asarray(losing[labels])


def _with_evidence(things: Mask, lost: Mask, gone: Mask, appeared: Mask) -> Mask:
    """Keep what shows in more than one way.

    Edges alone may fade where lamps and flash shade a surface in opposite ways; light alone is lost
    where a lamp changed; and what only appeared may be the flash's shadow or gloss, if not large.
    """
    count, labels, stats, _ = cv2.connectedComponentsWithStats(things.astype(np.uint8))
    area = np.maximum(stats[:, cv2.CC_STAT_AREA], 1)

    def share(evidence: Mask) -> Floats64:
        return np.asarray(np.bincount(labels[evidence], minlength=count) / area)

    kept = (share(gone) > _EVIDENCE) & (share(lost | appeared) > _EVIDENCE)
    kept |= (share(lost) > _EVIDENCE) & (share(gone | appeared) > _EVIDENCE)
    kept |= (share(appeared) > _EVIDENCE) & (area > _ALONE * things.size)
    kept[0] = False  # the background
    return np.asarray(kept[labels])

"""How noisy a photograph is, by its flat areas and by what another of the same things shares."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats, Floats32, Floats64
from pipeline.images.area_means import area_means
from pipeline.images.frames import Image, Mask, Photograph
from pipeline.images.noise import GRAIN_SCALES, Noise, line_through
from pipeline.images.quantiles import quantile
from pipeline.images.tiles import TILE_ROWS, tiles
from pipeline.pair.second_differences import (
    BLOCK,
    block_squares,
    block_variances,
    relative_squares,
    squares_within,
    unshared_squares,
)
from pipeline.threads import at_once

_BINS = 24  # of brightness, through whose points the line is laid
_MANY = 240  # blocks of 2×2 means; of fewer the other photograph explains more by chance
_SMALLEST = 32  # times the side of a grain that is looked for, of the shorter side
_SPARSE = 8  # pixels between those that tell the typical colour
_ENOUGH = 2_000_000  # pixels to tell the noise by
_FEW = 50  # second differences that still give a quantile
_QUIET = 0.25  # quantile of the blocks' variances, below most texture
_QUIET_OF_MEAN = 0.735
"""That quantile over the mean: χ² of 14.8 degrees of freedom, over 14.8.

So many have the 6 × 8 second differences of a block, n²/Σρ² with ρ = 1, −2/3, 1/6 along each axis.
"""
_ROUNDS = 5  # of laying the line anew by the differences within
_WITHIN, _WITHIN_OF_ALL = 2.5, 0.911  # standard deviations; variance of what lies within them
_MOST = 0.45  # share that lies within, or the quieter blocks are not like the others
_LESS = 0.5  # of its own; few independent pixels, as compression leaves, explain more by chance
_LEAST = 0.01  # of its own: no lamp is just a matrix of all colours of a texture
_FLAT = 2.1  # times the noise's variance; of blocks without texture 1 in 300 is above
_WHITE = 2.0  # factor by which the variance of means may miss that of independent pixels
_BESIDE = 4  # pixels around unusable ones that demosaicing and denoising have drawn into them
_SAME = 1e-6  # of white; what interpolation leaves of one value
_UPPER, _UPPER_OF_MEAN = 0.75, 1.32  # quantile of χ² of one degree of freedom over its mean


def estimate_noises(
    first: Photograph, second: Photograph, unusable: Mask | None = None, compressed: bool = False
) -> tuple[Noise, Noise]:
    """Estimate the noise of two photographs from flat areas, and from what they do not share.

    first, second: (H, W, 3) linear, of the same things in different light. unusable: (H, W), what
    tells nothing of noise, like clipped areas, which seem to have none; neither do areas of one
    value in both, as of a frame drawn around them. Second differences
    (Immerkær 1996) give a variance per block; a straight line over brightness is fitted to the
    quieter blocks, because the busier ones hold texture. Where texture is everywhere, what the
    other photograph does not explain is less; it counts, but at least as a 100th. Done on the
    photographs and on means of 2×2 pixels, since denoising and compression leave noise that hides
    from neighbouring pixels; smaller than 64 pixels, once. Its grain comes from means of ever more
    pixels, of which texture that both share is no part either, unless either was compressed or is
    small: of so few independent values, the other's explain more by chance. Of photographs of more
    than two million pixels, two are looked at, in tiles all over the picture.
    """
    height, width = first.shape[:2]
    large = height * width > _ENOUGH
    rows = TILE_ROWS if large else height
    scales = [s for s in GRAIN_SCALES if min(height, width) >= _SMALLEST * s]
    one, other = (
        tiles(each, _ENOUGH) if large else np.ascontiguousarray(each[:]) for each in (first, second)
    )
    marked = np.zeros((height, width), np.bool_) if unusable is None else unusable
    marked = (tiles(marked, _ENOUGH) if large else marked) | (_even(one) & _even(other))
    known = [_open_blocks(marked, side * BLOCK) for side in (1, *scales)]
    means, other_means = (_means_of(pixels, scales) for pixels in (one, other))
    own, others = at_once(
        lambda two: _noise_of(*two, known, rows, scales, compressed),
        ((means, other_means), (other_means, means)),
    )
    return own, others


def _means_of(pixels: Image, scales: list[int]) -> list[Image]:
    """A picture, and means over squares of its pixels, each scale twice as wide as the last."""
    means = [pixels]
    for _ in scales:
        means.append(_halved(means[-1]))
    return means


def _even(pixels: Image) -> Mask:
    """Pixels (H, W) around which all are of one value, as no sensor sees them."""
    around = np.ones((2 * _BESIDE + 1, 2 * _BESIDE + 1), np.uint8)
    spread = cv2.dilate(pixels, around) - cv2.erode(pixels, around)
    return np.asarray((spread <= _SAME).all(axis=2))


def _open_blocks(marked: Mask, side: int) -> Mask:
    """Blocks (H // side, W // side) without a marked pixel in or beside them."""
    height, width = (length // side for length in marked.shape)
    if not marked.any():
        return np.ones((height, width), np.bool_)
    kernel = np.ones((2 * _BESIDE + 1, 2 * _BESIDE + 1), np.uint8)
    near = cv2.dilate(marked.astype(np.uint8), kernel)[: height * side, : width * side]
    return np.asarray(near.reshape(height, side, width, side).max(axis=(1, 3)) == 0)


def _noise_of(
    means: list[Image],
    others: list[Image],
    known: list[Mask],
    rows: int,
    scales: list[int],
    compressed: bool,
) -> Noise:
    """The noise of a picture, of which others show the same things.

    means, others: as of _means_of. known: their blocks that tell of noise. rows, scales: as in
    _grain. compressed: as of estimate_noises.
    """
    typical = np.median(means[0][::_SPARSE, ::_SPARSE].reshape(-1, 3), axis=0)

    def line(at: int) -> tuple[Floats64, Floats64]:
        few = np.count_nonzero(known[at]) < _BINS
        return _line(means[at], others[at], typical, np.ones_like(known[at]) if few else known[at])

    def level(gain: Floats64, floor: Floats64) -> float:
        return float((gain * np.maximum(typical, 0) + floor).sum())

    lines = [line(at) for at in range(min(len(means), 2))]
    noise = Noise(*max(lines, key=lambda one: level(*one)))
    most = []
    shared = not compressed and len(known) > 1 and np.count_nonzero(known[1]) >= _MANY
    for at, scale in enumerate(scales, start=1):
        told = shared and np.count_nonzero(known[at]) >= _BINS
        found = level(*(lines[1] if at == 1 else line(at))) if told else np.inf
        most.append(scale**2 * found / level(noise.gain, noise.floor))
    grain = _grain(means, known[0], rows, scales, lines[0], noise, most)
    return Noise(noise.gain, noise.floor, grain)


def _grain(
    means: list[Image],
    known: Mask,
    rows: int,
    scales: list[int],
    line: tuple[Floats64, Floats64],
    noise: Noise,
    most: list[float],
) -> float:
    """Area over which the noise hangs together, from means of ever more pixels.

    means: as of _means_of. known: blocks of pixels that tell of noise. rows: of pixels that hang
    together. scales: of GRAIN_SCALES. most: what is left at each without what the other photograph
    shares; it counts where it is less than half, as for the noise itself.
    """
    grain = 1.0
    if not scales:
        return grain
    flat = _flat_blocks(means[0], line) & known
    for scale, pixels, unshared in zip(scales, means[1:], most, strict=True):
        found = scale**2 * _relative_variance(pixels, flat, rows // scale, scale, noise)
        found = unshared if unshared < _LESS * found else found
        if scale == scales[0] and abs(np.log(max(found, 1e-9))) < np.log(_WHITE):
            break  # bare noise: what larger means hold beyond it is texture
        grain = max(grain, found)
    return grain


def _halved(pixels: Image) -> Image:
    size = (pixels.shape[1] // 2, pixels.shape[0] // 2)
    return area_means(pixels, size, (size[0] * 2, size[1] * 2))


def _line(pixels: Image, others: Image, typical: Floats, known: Mask) -> tuple[Floats64, Floats64]:
    """Gain and floor of each channel; typical: (3,), where two lines are compared.

    known: blocks that are looked at.
    """
    blocks = np.flatnonzero(known)
    means, alone = block_squares(pixels)
    unshared = unshared_squares(pixels, others)
    gains, floors = np.empty((2, 3))
    for c in range(3):
        order = blocks[np.argsort(means[c][blocks])]
        bins = [b for b in np.array_split(order, _BINS) if len(b)]
        found = [_fit_line(means[c], bins, squares[c]) for squares in (alone, unshared)]
        levels = [gain * max(typical[c], 0.0) + floor for gain, floor in found]
        gains[c], floors[c] = found[0]
        if levels[1] < _LESS * levels[0]:
            raised = max(1.0, _LEAST * levels[0] / levels[1])
            gains[c], floors[c] = raised * found[1][0], raised * found[1][1]
    return gains, floors


def _flat_blocks(pixels: Image, line: tuple[Floats64, Floats64]) -> NDArray[np.bool_]:
    """Blocks (H // 8, W // 8) that hold no more than noise."""
    means, variances = block_variances(pixels)
    return np.asarray((variances < _FLAT * Noise(*line).variance(means)).all(axis=2))


def _relative_variance(
    means: Image, flat: NDArray[np.bool_], rows: int, scale: int, noise: Noise
) -> float:
    """Variance of means over scale × scale pixels in flat blocks, relative to the noise's.

    rows: of means that hang together. 0 where there are too few flat places of that size to tell.
    """
    covered = cv2.resize(  # blocks are whole means, and what lies beyond them is not flat
        flat.astype(np.uint8),
        None,
        fx=BLOCK // scale,
        fy=BLOCK // scale,
        interpolation=cv2.INTER_NEAREST,
    )
    whole = np.zeros(means.shape[:2], dtype=np.uint8)
    height, width = np.minimum(whole.shape, covered.shape)
    whole[:height, :width] = covered[:height, :width]
    inside = cv2.erode(
        whole, np.ones((3, 3), np.uint8), borderType=cv2.BORDER_CONSTANT, borderValue=0
    ).view(np.bool_)
    inside[::rows] = inside[rows - 1 :: rows] = False
    if np.count_nonzero(inside) < _FEW:
        return 0.0
    ratios = relative_squares(means, inside, noise.gain, noise.floor)
    return float(np.mean([quantile(of_channel, _UPPER) for of_channel in ratios])) / _UPPER_OF_MEAN


def _fit_line(
    means: Floats32, bins: list[NDArray[np.intp]], squares: Floats32
) -> tuple[float, float]:
    """Gain and floor of the noise between the edges; bins: of blocks by their brightness.

    The quieter blocks give a first line; then all differences within 2.5 standard deviations of
    it count, so that a block with an edge tells by its other pixels.
    """
    order, starts = np.concatenate(bins), np.cumsum([0, *map(len, bins[:-1])])
    brightness = np.array([means[b].mean() for b in bins])
    variances = squares.mean(axis=1)
    quiet = np.array([quantile(variances[b], _QUIET) for b in bins]) / _QUIET_OF_MEAN
    gain, floor = line_through(brightness, quiet)
    for _ in range(_ROUNDS):
        limit = np.asarray(_WITHIN**2 * (gain * np.maximum(means, 0.0) + floor), np.float32)
        counts, totals = squares_within(squares, limit)
        if counts[order].sum() / (len(order) * squares.shape[1]) < _MOST:
            break
        total, count = (np.add.reduceat(of[order], starts) for of in (totals, counts))
        gain, floor = line_through(brightness, total / np.maximum(count, 1) / _WITHIN_OF_ALL)
    return gain, floor

"""The pair at a size at which lamps are estimated: faster, and with less noise, than in full."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from pipeline.arrays import Floats, Floats32
from pipeline.images.blocks import Blocks, blocks_within
from pipeline.images.frames import Image, Mask
from pipeline.images.memory import releasable
from pipeline.images.noise import Noise
from pipeline.images.sigma_filter import ROUNDS, sigma_filter
from pipeline.images.strips import strips, widened
from pipeline.pair.misregistration import SOFTENED_HALO, registration_variance, softened
from pipeline.pair.pair import Pair
from pipeline.pair.placing import place_flash, placement

_LONG_SIDE = 512  # blocks at most
_BLOCK_ROWS = 16  # worked on at a time
_MIN_OPEN = 0.5  # share of a block's pixels that must be usable
_SIGNIFICANT = 4.0  # standard deviations
# relative; wide averages bend light that changes more than this, and a rendering bends it, too
_LITTLE_NOISE, _LITTLE_NOISE_RENDERED = 0.005, 0.0125
_QUIETER = 3.0  # times, by a round in which all nine pixels join
_LIKELY_OFFSET = 0.4  # of the registration's deviation: most pixels beside edges lie better
_MIN_FLASH, _MIN_LIGHT = 0.01, 0.003  # of the 99th percentile; darker pixels are mostly stray light


@dataclass(frozen=True)
class ReducedPair:
    """Block means of a pair, unusable pixels left out.

    no_flash, flash: float32 (h, w, 3) linear; flash is the flash part alone.
    no_flash_variance, flash_variance: float32 (h, w, 3), of the means.
    usable: bool (h, w): enough light of both kinds to tell lamps by.
    block: side of a block in pixels of the pair.
    rendered: whether a camera's rendering has bent the values.
    dropped: (width, height) of what is left over of the pair after whole blocks, in pixels.
    offset: standard deviation, in blocks, of what the flash part lies beside the other photograph;
    0 where it was not laid on it.
    flash_only: whether the flash part was given alone, and is no difference of photographs.
    """

    no_flash: Image
    flash: Image
    no_flash_variance: Image
    flash_variance: Image
    usable: Mask
    block: int
    rendered: bool
    dropped: tuple[int, int] = (0, 0)
    offset: float = 0.0
    flash_only: bool = False

    @property
    def covariance(self) -> Image:
        """Of both kinds of means, (h, w, 3): a difference lacks what noise adds to no_flash."""
        return np.zeros_like(self.no_flash_variance) if self.flash_only else -self.no_flash_variance

    @property
    def middle(self) -> tuple[float, float]:
        """The middle (x, y) of the pair, in blocks from the middle of the first."""
        sides = self.usable.shape[::-1]
        x, y = (side + left / self.block for side, left in zip(sides, self.dropped, strict=True))
        return x / 2 - 0.5, y / 2 - 0.5


def variance_left(
    mixed: Image, no_flash_variance: Image, flash_variance: Image, covariance: Image
) -> Image:
    """Variance (…, 3) of the lamps' light less mixed (…, 3, 3) times the flash part.

    The others: (…, 3), as those of a ReducedPair, of all or some of its means.
    """
    through = np.einsum("...kl,...l->...k", mixed * mixed, flash_variance)
    shared = np.diagonal(mixed, axis1=-2, axis2=-1) * covariance
    return np.asarray(no_flash_variance + through - 2 * shared, np.float32)


def reduce_pair(pair: Pair) -> ReducedPair:
    """Average blocks of the pair so that its longer side has at most 512 of them.

    The noise that is left is filtered as in the full-size pair, in as many rounds as it takes to
    leave little. What is left over at the right and bottom edge after whole blocks is dropped.
    """
    height, width = pair.unusable.shape
    blocks = blocks_within(width, height, _LONG_SIDE)
    block = blocks.side
    share, no_flash, flash = _means_of_open(pair, blocks)
    filled: Image = np.maximum(share, 1.0 / block**2)[..., None]
    no_flash, flash = no_flash / filled, flash / filled
    noises = (pair.no_flash_noise.of_means(block), pair.flash_noise.of_means(block))
    little = _LITTLE_NOISE_RENDERED if pair.rendered else _LITTLE_NOISE
    rounds = _rounds((no_flash, flash), noises, pair.flash_only, little)
    no_flash, flash, averaged = sigma_filter((no_flash, flash), noises, rounds)
    count = np.maximum(share * block**2, 1.0)[..., None] * averaged[..., None]
    no_flash_variance = pair.no_flash_noise.variance(no_flash, count)
    flash_variance = pair.flash_noise.variance(flash, count)
    beside = None
    if pair.registration_px > 0:
        beside = registration_variance(flash, pair.registration_px / block)
        flash_variance += _LIKELY_OFFSET**2 * beside
    if not pair.flash_only:
        flash = flash - no_flash
        flash_variance = flash_variance + no_flash_variance
    if beside is not None:
        placed = placement(flash.sum(axis=2), beside.sum(axis=2))
        flash = place_flash(no_flash, flash, placed, share)
    usable = (
        (share >= _MIN_OPEN)
        & _bright(flash, flash_variance, _MIN_FLASH)
        & _bright(no_flash, no_flash_variance, _MIN_LIGHT)
    )
    return ReducedPair(
        no_flash=no_flash,
        flash=flash,
        no_flash_variance=no_flash_variance.astype(np.float32),
        flash_variance=flash_variance.astype(np.float32),
        usable=usable,
        block=block,
        rendered=pair.rendered,
        dropped=(width - blocks.crop[0], height - blocks.crop[1]),
        offset=pair.registration_px / block,
        flash_only=pair.flash_only,
    )


def unusable_where(blocks: Mask, pair: Pair, block: int) -> Pair:
    """The pair, unusable in these blocks (h, w) of its reduced one too, block pixels to a side."""
    unusable = pair.unusable.copy()
    height, width = (block * side for side in blocks.shape)
    inside = unusable[:height, :width]
    inside |= blocks.repeat(block, axis=0).repeat(block, axis=1)[: len(inside), : inside.shape[1]]
    return replace(pair, unusable=releasable(unusable))


def _means_of_open(pair: Pair, blocks: Blocks) -> tuple[Floats32, Image, Image]:
    """Means over blocks of what is usable, of the photographs with 0 where they are not."""
    side, (width, height) = blocks.side, blocks.size
    share = np.empty((height, width), np.float32)
    no_flash, flash = np.empty((2, height, width, 3), np.float32)
    for some_rows in strips(height, _BLOCK_ROWS):
        some = (width, some_rows.stop - some_rows.start)
        rows, columns = slice(some_rows.start * side, some_rows.stop * side), slice(width * side)
        unusable = pair.unusable[rows, columns]
        share[some_rows] = _means((~unusable).astype(np.float32), some)
        for picture, means in ((pair.no_flash, no_flash), (pair.flash, flash)):
            light = picture[rows, columns]
            if pair.registration_px > 0:
                wide, inner = widened(rows, SOFTENED_HALO, height * side)
                light = softened(picture[wide, columns])[inner]
            if unusable.any():
                light = light.copy()
                light[unusable] = 0.0
            means[some_rows] = _means(light, some)
    return share, no_flash, flash


def _rounds(
    images: tuple[Image, Image], noises: tuple[Noise, Noise], flash_only: bool, little: float
) -> int:
    """How often to average until little relative noise is left in what flash and lamps light."""
    light, part = (image.sum(axis=2) for image in images)
    variance, part_variance = (
        noise.variance(image).sum(axis=2) for noise, image in zip(noises, images, strict=True)
    )
    if not flash_only:
        part, part_variance = part - light, part_variance + variance
    lit = (light > 0) & (part > max(_MIN_FLASH * np.percentile(part, 99), 0.0))
    if not lit.any():
        return ROUNDS
    squared = variance[lit] / light[lit] ** 2 + part_variance[lit] / part[lit] ** 2
    too_much = np.sqrt(np.median(squared)) / little
    return int(np.clip(np.ceil(np.log(max(too_much, 1.0)) / np.log(_QUIETER)), 0, ROUNDS))


def _means(image: Floats32, size: tuple[int, int]) -> Floats32:
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA))


def _bright(image: Image, variance: Floats, floor: float) -> Mask:
    total = image.sum(axis=2)
    enough = (total > _SIGNIFICANT * np.sqrt(variance.sum(axis=2))) & (
        total > floor * np.percentile(total, 99)
    )
    return np.asarray(enough & (image > 0).all(axis=2))

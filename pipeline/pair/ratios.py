"""The flash photograph over the other, block by block, and what it says of their exposures.

Where the flash does not reach, both photographs hold the lamps' light alone: there the flash
photograph is the other one times the ratio of the exposures, alike in all three channels, and
nowhere is it darker. What departs from that tells of a wrong ratio, or of lamps that changed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from pipeline.arrays import Floats64
from pipeline.images.area_means import area_means
from pipeline.images.blocks import any_in_blocks, blocks_within
from pipeline.images.frames import Mask, Photograph
from pipeline.images.noise import Noise
from pipeline.threads import at_once

_LONG_SIDE = 384  # blocks
_DARK = 0.01  # of the 99th percentile; darker blocks are mostly stray light
_SURE = 0.05  # noise of a block's logarithm
_ALIKE = 0.03  # natural logarithms; channels of blocks without flash differ by less, or by noise
_BIN = 0.02  # natural logarithms, as what follows
_PEAK = 0.04  # half width of the peak that blocks without flash make
_PEAK_SHARE = 0.02  # of the blocks that are sure, at least
_PEAK_COLOUR = 0.02  # by which its channels differ at most: all its blocks average their noise
_BELOW = 0.1  # of the blocks may lie below the peak: what moved
_VALLEY = (0.06, 0.14, 0.5)  # above the peak from, to; share of the peak's blocks there at most
_FLASH_COLOUR = 0.12  # by which channels of blocks with flash differ, or colour tells nothing
_NEGATIVE = 0.05  # logarithm, below the ratio: darker with the flash than without
_NEGATIVE_RENDERED = 0.25  # the same where a camera's curves differ
_FEW_BLOCKS = 200  # with fewer nothing is told
_LOWEST = 0.002  # quantile: blocks below it may be chance
_SURELY = 2.0  # standard deviations


@dataclass(frozen=True)
class Ratios:
    """Flash photograph ÷ no-flash photograph in blocks of the pair.

    no_flash: float64 (h, w, 3) > 0, light of that photograph. logs: (h, w, 3), natural logarithms
    of the ratios. noise: (h, w, 3), their standard deviations. usable: bool (h, w), bright and
    unclipped in both. block: side of a block in pixels.
    """

    no_flash: Floats64
    logs: Floats64
    noise: Floats64
    usable: Mask
    block: int

    @cached_property
    def sure(self) -> Mask:
        """Blocks whose noise leaves the ratio known within 5 %."""
        return np.asarray(self.usable & (self.noise.max(axis=2) < _SURE))

    def without(self, pixels: Mask) -> Ratios:
        """Leave out the blocks that hold a pixel of a mask (H, W)."""
        return replace(self, usable=self.usable & ~any_in_blocks(pixels, self.block))

    def transposed(self) -> Ratios:
        """The same with rows and columns changed, (w, h)."""
        return Ratios(
            self.no_flash.transpose(1, 0, 2),
            self.logs.transpose(1, 0, 2),
            self.noise.transpose(1, 0, 2),
            self.usable.T,
            self.block,
        )


def block_ratios(
    no_flash: Photograph, flash: Photograph, unusable: Mask, noises: tuple[Noise, Noise]
) -> Ratios:
    """Divide the flash photograph by the other, block by block, at most 384 to a side.

    no_flash, flash: (H, W, 3) linear, aligned, the flash photograph with the lamps' light in it.
    unusable: (H, W). noises: of each.
    """
    height, width = unusable.shape
    blocks = blocks_within(width, height, _LONG_SIDE)
    means = at_once(partial(area_means, size=blocks.size, crop=blocks.crop), (no_flash, flash))
    before, after = (image.astype(np.float64) for image in means)
    total = before.sum(axis=2)
    usable = (
        ~any_in_blocks(unusable, blocks.side)
        & (before > 0).all(axis=2)
        & (after > 0).all(axis=2)
        & (total > _DARK * np.percentile(total, 99))
    )
    first, second = np.maximum(before, 1e-9), np.maximum(after, 1e-9)
    relative = [
        noise.of_means(blocks.side).variance(image) / np.square(image)
        for noise, image in zip(noises, (first, second), strict=True)
    ]
    deviation = np.sqrt(relative[0] + relative[1])
    return Ratios(first, np.log(second / first), deviation, usable, blocks.side)


def ratio_without_flash(ratios: Ratios) -> float | None:
    """Ratio of the exposures by what the flash does not reach; None where that does not show.

    It must show as a peak at the lower end of all ratios, whose blocks have the same ratio in all
    channels, in a scene where the flash's own colour is another.
    """
    logs, noise = ratios.logs[ratios.sure], ratios.noise[ratios.sure]
    if len(logs) < _FEW_BLOCKS:
        return None
    middle = logs.mean(axis=1)
    spread = logs.max(axis=1) - logs.min(axis=1)
    alike = spread < np.maximum(_ALIKE, 3 * noise.max(axis=1))
    if np.count_nonzero(alike) < _PEAK_SHARE * len(logs):
        return None
    edges = np.arange(middle.min() - _BIN, middle.max() + 2 * _BIN, _BIN)
    counts, _ = np.histogram(middle[alike], edges)
    smooth = np.convolve(counts, np.ones(3), "same")
    mode = float(edges[int(np.argmax(smooth))] + _BIN / 2)
    peak = np.abs(middle - mode) < _PEAK
    mode = float(np.median(middle[peak & alike]))
    valley = (middle > mode + _VALLEY[0]) & (middle < mode + _VALLEY[1])
    lit = middle > mode + 2 * _VALLEY[1]
    if (
        np.mean(peak & alike) < _PEAK_SHARE
        or np.mean(middle < mode - _VALLEY[0]) > _BELOW
        or np.count_nonzero(valley) > _VALLEY[2] * np.count_nonzero(peak)
        or np.ptp(np.median(logs[peak & alike], axis=0)) > _PEAK_COLOUR
        or not lit.any()
        or np.median(spread[lit]) < max(_FLASH_COLOUR, 2 * float(np.median(spread[peak])))
    ):
        return None
    return float(np.exp(mode))


def darker_share(ratios: Ratios, rendered: bool) -> float:
    """Share of the blocks that the flash seems to have made darker, in every channel, 0…1."""
    least = _NEGATIVE_RENDERED if rendered else _NEGATIVE
    sure = ratios.sure
    if np.count_nonzero(sure) < _FEW_BLOCKS:
        return 0.0
    logs = ratios.logs[sure]
    threshold = np.maximum(least, 4 * _noise_of_means(ratios))
    darker = (logs < 0).all(axis=1) & (logs.mean(axis=1) < -threshold)
    return float(np.mean(darker))


def brightening(ratios: Ratios) -> float:
    """By how much the flash photograph must be brighter for no block to be surely darker, ≥ 1."""
    if not ratios.sure.any():
        return 1.0
    logs = ratios.logs[ratios.sure].mean(axis=1) + _SURELY * _noise_of_means(ratios)
    return float(np.exp(-min(np.quantile(logs, _LOWEST), 0.0)))


def _noise_of_means(ratios: Ratios) -> Floats64:
    """Standard deviation of the mean over channels in the blocks that are sure."""
    return np.asarray(np.sqrt(np.square(ratios.noise[ratios.sure]).mean(axis=1) / 3))

"""What surfaces are painted with: plain, chequered, striped, patched, or mixed like natural things.

A pattern is painted on the unit square of a surface's own coordinates. Every texel is a mixture of
two reflectances of the scene's palette.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats32, Floats64

_TEXTURE_SIDE = 256
_ROUGHEST = 64.0  # cycles per side


@dataclass(frozen=True)
class Pattern:
    """A pattern of some colours.

    colours: places in the palette. cells: per side of a checker or patches, stripes across; of a
    texture how often it is laid side by side. seed: of what is random.
    """

    kind: Literal["plain", "checker", "stripes", "patches", "texture"]
    colours: tuple[int, ...]
    cells: int = 1
    seed: int = 0


@dataclass(frozen=True)
class Texels:
    """A painted pattern: reflectance = (1 − share)·palette[first] + share·palette[second].

    All (h, w), first row at v = 0. share: 0 to 1.
    """

    first: NDArray[np.int16]
    second: NDArray[np.int16]
    share: Floats32

    def at(self, u: Floats64, v: Floats64) -> Texels:
        """Look up the texels at surface coordinates of any shape; they repeat outside 0 to 1."""
        height, width = self.first.shape
        row = np.minimum((v % 1.0 * height).astype(np.intp), height - 1)
        column = np.minimum((u % 1.0 * width).astype(np.intp), width - 1)
        return Texels(self.first[row, column], self.second[row, column], self.share[row, column])


def paint(pattern: Pattern) -> Texels:
    """Paint a pattern; the same pattern gives the same texels."""
    random = np.random.default_rng(pattern.seed)
    colours = np.array(pattern.colours, np.int16)
    if pattern.kind == "texture":
        return _mixture(colours, pattern.cells, random)
    across = np.arange(pattern.cells)
    if pattern.kind == "plain":
        which = np.zeros((1, 1), np.intp)
    elif pattern.kind == "checker":
        which = (across[:, None] + across) % len(colours)
    elif pattern.kind == "stripes":
        which = across[:, None] % len(colours)
    else:
        which = random.integers(len(colours), size=(pattern.cells, pattern.cells))
    flat = colours[which]
    return Texels(flat, flat, np.zeros(flat.shape, np.float32))


def _mixture(colours: NDArray[np.int16], repeats: int, random: np.random.Generator) -> Texels:
    """Pass from colour to colour as 1/f noise rises and falls, as in stone, wood and foliage."""
    frequency = np.fft.fftfreq(_TEXTURE_SIDE, 1 / _TEXTURE_SIDE)
    radius = np.hypot(frequency[:, None], frequency)
    weight = np.where((radius > 0) & (radius <= _ROUGHEST), 1 / np.maximum(radius, 1) ** 1.4, 0)
    noise = np.fft.ifft2(np.fft.fft2(random.standard_normal(radius.shape)) * weight).real
    low, high = np.percentile(noise, [5, 95])
    along = np.clip((noise - low) / (high - low), 0, 1) * (len(colours) - 1)
    step = np.minimum(along.astype(np.intp), len(colours) - 2)
    tile = (repeats, repeats)
    return Texels(
        np.tile(colours[step], tile),
        np.tile(colours[step + 1], tile),
        np.tile((along - step).astype(np.float32), tile),
    )

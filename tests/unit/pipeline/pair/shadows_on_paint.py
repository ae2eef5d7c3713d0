"""Shadows of two lamps and a flash without edges on patches of paint, through curves."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np

from pipeline.arrays import Floats64
from pipeline.colour.curves import linear_to_srgb, srgb_to_linear
from pipeline.images.coded_image import TableImage
from pipeline.images.frames import Mask, Photograph
from pipeline.pair.balance_change import TO_SENSOR
from pipeline.pair.one_surface import (
    Neighbours,
    PairBlocks,
    average_pair,
    find_neighbours,
)

Curve = Callable[[Floats64], Floats64]
Shadows = Literal["slanted", "upright", "level", "none"]

SIZE = 288, 216
PATCH = 24


def s_curve(strength: float) -> Curve:
    """Code values moved away from the middle."""
    return lambda codes: codes - strength * np.sin(2 * np.pi * codes)


def light_of(shadows: Shadows = "slanted", flash: float = 0.35) -> tuple[Floats64, Floats64]:
    """Light (H, W, 3) without and with a flash. shadows: how their edges run."""
    random = np.random.default_rng(3)
    width, height = SIZE
    paints = random.uniform(0.25, 0.95, (height // PATCH, width // PATCH, 3))
    paint = np.kron(paints, np.ones((PATCH, PATCH, 1)))
    y, x = np.mgrid[:height, :width]
    first, second = np.ones((2, height, width))
    if shadows != "none":
        along, across = {
            "slanted": (x + y // 2, y + x // 3),
            "upright": (x, x + 15),
            "level": (y, y + 15),
        }[shadows]
        first = np.where(along % 66 < 30, 0.05, 1.0)
        second = np.where(across % 78 < 36, 0.05, 1.0)
    lamps = first[..., None] * [0.3, 0.22, 0.12] + second[..., None] * [0.1, 0.16, 0.25]
    even = flash * (1 - 0.3 * ((x - 140) ** 2 + (y - 100) ** 2) / 3e4)[..., None]
    return paint * (lamps + 0.02), paint * (lamps + 0.02 + even)


def photographs(curve: Curve, light: tuple[Floats64, Floats64]) -> tuple[TableImage, TableImage]:
    """What a camera with this curve on top of sRGB's makes of light, in 8 bits."""
    table = srgb_to_linear(np.arange(256, dtype=np.float32) / 255)

    def coded(one: Floats64) -> TableImage:
        codes = curve(linear_to_srgb(np.clip(one, 0.0, 1.0)).astype(np.float64))
        return TableImage(np.round(255 * codes).astype(np.uint8), table)

    return coded(light[0]), coded(light[1])


def with_gains(flash: Floats64, red: float, blue: float) -> Floats64:
    """A photograph (H, W, 3) in linear sRGB whose sensor's channels are multiplied."""
    to_srgb = np.linalg.inv(TO_SENSOR)
    return np.asarray(flash @ (to_srgb @ (np.array((red, 1.0, blue))[:, None] * TO_SENSOR)).T)


def pair_of(
    red: float, blue: float, contrast: float = 0.0, exposure: float = 0.75, flash: float = 0.35
) -> tuple[TableImage, TableImage]:
    """Photographs of which that with the flash has gains, through an S of this contrast."""
    no_flash, both = light_of(flash=flash)
    return photographs(s_curve(contrast), (no_flash, exposure * with_gains(both, red, blue)))


def neighbours(
    pair: tuple[Photograph, Photograph], ratio: float = 1.0, unusable: Mask | None = None
) -> Neighbours:
    """Pairs of places of a pair that may show one paint."""
    found = find_neighbours(blocks(pair, unusable), ratio)
    assert found is not None
    return found


def blocks(pair: tuple[Photograph, Photograph], unusable: Mask | None = None) -> PairBlocks:
    """Blocks of a pair."""
    return average_pair(*pair, nothing() if unusable is None else unusable)


def neighbours_of(srgb: Floats64, ratio: float) -> Neighbours:
    """Pairs of places with that light (4, n, 3), numbered one after the other."""
    numbers = np.arange(2 * srgb.shape[1]).reshape(2, -1)
    return Neighbours(srgb, ratio, numbers, np.zeros(numbers.shape))


def nothing() -> Mask:
    """A mask of pixels that cannot be used, empty."""
    return np.zeros(SIZE[::-1], np.bool_)

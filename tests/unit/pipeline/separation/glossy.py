"""Scenes with highlights whose layers are known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats64
from pipeline.images.noise import Noise
from pipeline.lamps.lamps import Lamps
from pipeline.pair.pair import Pair
from pipeline.pair.reduced import ReducedPair, reduce_pair

Mask = NDArray[np.bool_]
SIZE = (120, 160)
PLACES = ((0.25, 0.25), (0.25, 0.7), (0.72, 0.5))
"""Where the first lamp is mirrored, the second, the flash: of the height and of the width."""
RADIUS = 0.055  # of the height
LOUD = Noise(np.full(3, 1e-5), np.full(3, 1e-9))


@dataclass(frozen=True)
class Scene:
    """A pair under two lamps, its true layers (2, H, W, 3), and masks (3, H, W) of what mirrors."""

    pair: Pair
    lamps: Lamps
    layers: Floats64
    mirrors: Mask

    @property
    def reduced(self) -> ReducedPair:
        """As separate takes it."""
        return reduce_pair(self.pair)


def discs(size: tuple[int, int], radius: float = RADIUS) -> Mask:
    """Round patches (3, H, W)."""
    v, u = np.mgrid[: size[0], : size[1]]
    return np.array(
        [np.hypot(v - size[0] * y, u - size[1] * x) < radius * size[0] for y, x in PLACES]
    )


def balanced(light: Floats64) -> dict[str, Floats64]:
    """Weights of the channels, as lamps that were found have them."""
    return {"channel_weights": 1 / light.mean(axis=(0, 1))}


def noisy(
    light: Floats64, flash: Floats64, noise: Noise | None, pair_of: Callable[..., Pair], **more: Any
) -> Pair:
    """A pair with the noise of a sensor, which it says that it has."""
    if not noise:
        return pair_of(light, flash, **more)
    grain = np.random.default_rng(8).normal(size=(2, *light.shape))
    before = light + grain[0] * np.sqrt(noise.variance(light))
    after = light + flash + grain[1] * np.sqrt(noise.variance(light + flash))
    return pair_of(before, after - before, no_flash_noise=noise, flash_noise=noise, **more)


def off(found: NDArray[Any], scene: Scene, where: Mask) -> float:
    """Relative error of the layers in some places."""
    error = np.linalg.norm((found - scene.layers)[:, where])
    return float(error / np.linalg.norm(scene.layers[:, where]))

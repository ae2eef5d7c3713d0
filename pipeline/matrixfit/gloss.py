"""Whether what a second lamp explains is light that surfaces mirror."""

from __future__ import annotations

import numpy as np

from pipeline.arrays import Floats32, Floats64
from pipeline.light.shares import shares
from pipeline.pair.reduced import ReducedPair, variance_left

_AS_MUCH = 0.8  # of what a second lamp explains
_LITTLE = 2e-4  # of the light, squared: what one lamp and gloss may leave over
_NOTHING = 2e-5  # the same: what they may leave more than a second lamp that leaves nothing
_MOST = 0.0025  # of a pixel's light, squared: what is further off tells of neither


def is_gloss(reduced: ReducedPair, one: Floats64, two: Floats64, flash_white: Floats64) -> bool:
    """Whether one lamp (1, 3, 3) and mirrored light explain as much as two lamps (2, 3, 3) do.

    What a surface mirrors has the colour of the lamp and not of the surface (Shafer 1985). Where
    the flash is mirrored, the lamp seems to give less of it.

    flash_white: (3,) camera RGB of a white card under the flash.
    """
    use = reduced.usable
    light, flash = reduced.no_flash[use], reduced.flash[use]
    weights = (1.0 / light.mean(axis=0)).astype(np.float32)
    light = light * weights
    matt, first, second = (flash @ (m.T * weights).astype(np.float32) for m in (*one, *two))
    mirrored = np.broadcast_to((one[0] @ flash_white * weights).astype(np.float32), light.shape)
    mixed = shares(light, matt[None])[0][:, None, None] * one[0]
    variances = (reduced.no_flash_variance, reduced.flash_variance, reduced.covariance)
    variance = variance_left(mixed, *(image[use] for image in variances))
    noise = (np.square(weights) * variance).sum(axis=1)
    alone = _left_over(light, matt[None], noise)
    with_second = _left_over(light, np.stack([first, second]), noise)
    with_gloss = np.minimum(
        _left_over(light, np.stack([matt, mirrored]), noise),
        _left_over(light, np.stack([matt, -mirrored]), noise),
    )
    worth = np.linalg.norm(light, axis=1)
    worth = worth / worth.sum()
    by_none, by_gloss, by_second = (worth @ one for one in (alone, with_gloss, with_second))
    explained = by_none - by_gloss >= _AS_MUCH * (by_none - by_second)
    # of the light of a second lamp gloss may explain most, and leaves many times what that leaves
    as_little = by_gloss - by_second < max(by_second, _NOTHING)
    return bool(explained and as_little and by_gloss < _LITTLE)


def _left_over(light: Floats32, colours: Floats32, noise: Floats64) -> Floats64:
    """Light (n,) that mixtures of colours (k, n, 3) leave over, squared, less noise, of its own."""
    explained = (shares(light, colours)[..., None] * colours).sum(axis=0)
    # each colour follows the noise of one of three channels
    left = np.square(light - explained).sum(axis=1) - (3 - len(colours)) / 3 * noise
    return np.asarray(np.clip(left / np.square(light).sum(axis=1), -_MOST, _MOST))

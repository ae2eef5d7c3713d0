"""From the pair and its lamps to the light of each lamp, a strip of rows at a time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline import registration, sigma_filter, smoothing
from pipeline.fill import Surroundings
from pipeline.frames import Image
from pipeline.hui2018.separation import published_layers
from pipeline.lamps import Lamps
from pipeline.model import Model
from pipeline.pair import Pair
from pipeline.progress import Progress
from pipeline.proportions import model_proportions
from pipeline.reduced import ReducedPair

_UNUSABLE_REACH = 1
_DOUBT = 1.5  # standard deviations of a pixel's light at which it counts for a little less


@dataclass(frozen=True)
class Strip:
    """Some rows of the separated pair.

    rows: which. layers: float32 (N, h, W, 3), each lamp's light, linear camera RGB, 1.0 = white
    level of the no-flash photograph. no_flash, flash: (h, W, 3), the no-flash photograph and the
    flash part, for `best` with their noise filtered. confidence: (h, W) 0…1, 0 where the layers
    are filled in from the surroundings.
    """

    rows: slice
    layers: NDArray[np.float32]
    no_flash: Image
    flash: Image
    confidence: NDArray[np.float32]


def separate(
    pair: Pair,
    reduced: ReducedPair,
    lamps: Lamps,
    model: Model,
    method: str,
    progress: Progress,
    strip_rows: int,
) -> Iterator[Strip]:
    """Separate the pair, top to bottom.

    method: "paper" gives eq. 3 of Hui et al. 2018 as it is. "best" takes shares by non-negative
    least squares in the image, on the pair with its noise filtered, and deals the unfiltered
    photograph out in the proportions of the model's layers: the layers add up to the photograph
    and its noise is not amplified. Pixels without a usable flash part take the proportions of
    their surroundings. The result does not depend on strip_rows.
    """
    height, width = pair.unusable.shape
    surroundings = Surroundings(reduced, lamps)
    for rows in progress.strips("layers", height, strip_rows):
        if method == "paper":
            no_flash = pair.no_flash[rows]
            flash = pair.flash[rows] - (0 if pair.flash_only else no_flash)
            layers = published_layers(
                no_flash, flash, lamps.coefficients, model.tensor, model.published
            )
            yield Strip(rows, layers, no_flash, flash, _open(pair, rows))
            continue
        wide, inner = _widened(rows, smoothing.HALO, height)
        no_flash, flash = _filtered(pair, wide)
        confidence = _open(pair, wide) * _certainty(pair, wide)
        uncertainty = _relative_noise(pair, wide) / lamps.contrast
        proportions = smoothing.smooth_proportions(
            model_proportions(no_flash, flash, lamps),
            no_flash,
            flash,
            confidence,
            np.minimum(uncertainty, 1.0),
            inner,
        )
        no_flash, flash, confidence = no_flash[inner], flash[inner], confidence[inner]
        trust = confidence[..., None]
        around = surroundings.rows(rows, width)
        layers = (trust * proportions + (1 - trust) * around) * pair.no_flash[rows]
        yield Strip(rows, layers, no_flash, flash, confidence)


def _widened(rows: slice, halo: int, height: int) -> tuple[slice, slice]:
    """Rows with a halo as far as the picture goes, and where the rows lie among them."""
    top, bottom = max(rows.start - halo, 0), min(rows.stop + halo, height)
    return slice(top, bottom), slice(rows.start - top, rows.stop - top)


def _filtered(pair: Pair, rows: slice) -> tuple[Image, Image]:
    """Return no-flash photograph and flash part of some rows, noise filtered."""
    halo = sigma_filter.HALO + (registration.SOFTENED_HALO if pair.registration > 0 else 0)
    wide, inner = _widened(rows, halo, len(pair.unusable))
    no_flash, flash = pair.no_flash[wide], pair.flash[wide]
    if pair.registration > 0:
        no_flash, flash = registration.softened(no_flash), registration.softened(flash)
    no_flash, flash, _ = sigma_filter.sigma_filter(
        (no_flash, flash), (pair.no_flash_noise, pair.flash_noise), inner
    )
    return no_flash, flash if pair.flash_only else flash - no_flash


def _open(pair: Pair, rows: slice) -> NDArray[np.float32]:
    """1 in usable pixels, 0 in unusable ones and beside them, where demosaicing mixes."""
    wide, inner = _widened(rows, _UNUSABLE_REACH, len(pair.unusable))
    kernel = np.ones((2 * _UNUSABLE_REACH + 1, 2 * _UNUSABLE_REACH + 1), dtype=np.uint8)
    near = cv2.dilate(pair.unusable[wide].astype(np.uint8), kernel)
    return np.asarray(1.0 - near[inner], dtype=np.float32)


def _certainty(pair: Pair, rows: slice) -> NDArray[np.float32]:
    """How far flash part and no-flash light stand out from their noise, 0…1."""
    certainty = np.ones((rows.stop - rows.start, pair.unusable.shape[1]))
    for light, variance in _light_and_noise(pair, rows):
        squared = np.square(np.maximum(light, 0.0))
        certainty *= squared / (squared + _DOUBT**2 * variance)
    return certainty.astype(np.float32)


def _relative_noise(pair: Pair, rows: slice) -> NDArray[np.float32]:
    """Noise of flash part and no-flash light against themselves, both together."""
    total = np.zeros((rows.stop - rows.start, pair.unusable.shape[1]))
    for light, variance in _light_and_noise(pair, rows):
        total += variance / np.maximum(np.square(light), variance)
    return np.sqrt(total).astype(np.float32)


def _light_and_noise(
    pair: Pair, rows: slice
) -> list[tuple[NDArray[np.float32], NDArray[np.float64]]]:
    """(light, its variance), summed over channels, (h, W): of the flash part, of the lamps."""
    no_flash, flash = pair.no_flash[rows], pair.flash[rows]
    no_flash_variance = pair.no_flash_noise.variance(no_flash).sum(axis=2)
    flash_variance = pair.flash_noise.variance(flash).sum(axis=2)
    if pair.registration > 0:
        wide, inner = _widened(rows, registration.HALO, len(pair.unusable))
        beside = registration.registration_variance(pair.flash[wide], pair.registration)
        flash_variance = flash_variance + beside[inner].sum(axis=2)
    light, part = no_flash.sum(axis=2), flash.sum(axis=2)
    if not pair.flash_only:
        part = part - light
        flash_variance = flash_variance + no_flash_variance
    return [(part, flash_variance), (light, no_flash_variance)]

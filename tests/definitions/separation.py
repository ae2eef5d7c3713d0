"""What pipeline.separation.separation computes, in plain NumPy and in one piece."""

from __future__ import annotations

import cv2
import numpy as np

from pipeline.arrays import Floats32, Floats64
from pipeline.images.sigma_filter import sigma_filter
from pipeline.lamps.lamps import Lamps
from pipeline.pair.misregistration import registration_variance, softened
from pipeline.pair.pair import Pair
from pipeline.pair.reduced import ReducedPair
from pipeline.separation.fill import Surroundings
from tests.definitions.highlights import deal_out, find_highlights
from tests.definitions.pixels import (
    mend_proportions,
    model_proportions,
    place_flash,
    smooth_proportions,
)

_DOUBT = 1.5
_INVISIBLE = 0.002
_MISPLACED = 0.03


def separate(
    pair: Pair, reduced: ReducedPair, lamps: Lamps, flash_white: Floats64
) -> tuple[Floats32, Floats64]:
    """pipeline.separation.separation.separate by "best", in one piece: layers, confidence."""
    pictures = pair.no_flash[:], pair.flash[:]
    if pair.registration_px > 0:
        pictures = softened(pair.no_flash[:]), softened(pair.flash[:])
    no_flash, flash, _ = sigma_filter(pictures, (pair.no_flash_noise, pair.flash_noise))
    if not pair.flash_only:
        flash = flash - no_flash
    confidence, placed, uncertainty = _reliability(pair, lamps.least_sine)
    near = cv2.dilate(pair.unusable.astype(np.uint8), np.ones((3, 3), np.uint8))
    confidence = np.where(near > 0, 0.0, confidence)
    if pair.registration_px > 0:
        flash = place_flash(no_flash, flash, placed, confidence)
    proportions = model_proportions(no_flash, flash, lamps)
    scale = 1.0
    if pair.flash_only:  # whose units are anybody's
        light, part = (one[reduced.usable].sum(axis=1) for one in (reduced.no_flash, reduced.flash))
        scale = float(np.median(light / part))
    parts = smooth_proportions(
        proportions,
        no_flash,
        flash * np.float32(scale),
        (confidence * placed).astype(np.float32),
        uncertainty.astype(np.float32),
        slice(None),
    )
    trust = confidence
    if pair.registration_px > 0:
        photograph = pair.no_flash[:]
        variance = pair.no_flash_noise.variance(photograph).sum(axis=2)
        parts, trust = mend_proportions(
            parts, proportions, photograph, variance, placed, confidence
        )
    found = find_highlights(reduced, lamps, flash_white)
    if found:
        parts = deal_out(found, no_flash, flash, lamps, parts)
    height, width = confidence.shape
    around = Surroundings(reduced, lamps).rows(slice(0, height), width)
    trust = trust[..., None]
    layers = (trust * parts + (1.0 - trust) * around) * pair.no_flash
    return layers.astype(np.float32), confidence


def _reliability(pair: Pair, least_sine: float) -> tuple[Floats64, Floats64, Floats64]:
    """Confidence, unusable pixels or not, how well placed they are, and uncertainty (H, W)."""
    light, part = pair.no_flash[:].sum(axis=2), pair.flash[:].sum(axis=2)
    variance = pair.no_flash_noise.variance(pair.no_flash[:]).sum(axis=2)
    part_variance = pair.flash_noise.variance(pair.flash[:]).sum(axis=2)
    beside = np.zeros(light.shape)
    if pair.registration_px > 0:
        beside += registration_variance(pair.flash[:], pair.registration_px).sum(axis=2)
    part_variance = part_variance + beside
    if not pair.flash_only:
        part, part_variance = part - light, part_variance + variance
    certain, relative = np.ones(light.shape), np.zeros(light.shape)
    for value, noise in ((part, part_variance), (light, variance)):
        squared = np.square(np.maximum(value, 0.0))
        certain *= squared / (squared + _DOUBT**2 * noise)
        relative += noise / np.maximum(np.square(value), noise)
    placed = 1.0 / (1.0 + beside / np.maximum(_MISPLACED * part, 1e-15) ** 2)
    visible = np.maximum(relative / least_sine**2 - _INVISIBLE**2, 0.0)
    return certain, placed, np.minimum(np.sqrt(visible), 1.0)

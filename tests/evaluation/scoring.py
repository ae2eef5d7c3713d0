"""How good layers and balanced pictures are, against renderings."""

from __future__ import annotations

from itertools import permutations

import numpy as np

from pipeline.arrays import Floats, Floats64
from pipeline.images.frames import Image, Mask

_MIN_FLASH = 0.01  # of the 99th percentile; below, hardly any light of the flash arrives


def valid_pixels(truth: Floats, flash: Image, white: float) -> Mask:
    """Pixels (H, W) that count, decided from the truth alone and so the same for all methods.

    They have a usable flash part, and neither photograph is clipped there.

    Parameters
    ----------
    truth : (N, H, W, 3), each lamp's light, linear camera RGB
    flash : (H, W, 3), the light of the flash alone
    white : the value at which a photograph of this light is clipped
    """
    strength = flash.sum(axis=2)
    lit = strength > _MIN_FLASH * np.percentile(strength, 99)
    brightest = (truth.sum(axis=0) + np.maximum(flash, 0.0)).max(axis=2)
    return np.asarray(lit & (brightest < white))


def joint_snr(truth: Floats, layers: Floats, valid: Mask) -> tuple[float, tuple[int, ...]]:
    """Signal-to-noise ratio of all layers together, and which layer is which lamp's.

    10·log10(Σ‖truth‖² / Σ‖truth − layer‖²) in dB over the valid pixels of every layer, in the best
    order; no layer is rescaled. Order: layers[order[j]] is the light of lamp j.

    Parameters
    ----------
    truth, layers : (N, H, W, 3) on one scale
    valid : (H, W)

    Raises ValueError for another number of layers than of lamps, or values that are not finite.
    """
    if truth.shape != layers.shape:
        raise ValueError(f"layers are {layers.shape} where the truth is {truth.shape}")
    wanted = truth[:, valid].astype(np.float64)
    found = layers[:, valid].astype(np.float64)
    if not np.isfinite(found).all():
        raise ValueError("layers hold values that are not finite")
    count = len(wanted)
    errors = np.array([[np.square(one - other).sum() for other in found] for one in wanted])
    order = min(
        permutations(range(count)), key=lambda order: errors[np.arange(count), list(order)].sum()
    )
    noise = errors[np.arange(count), list(order)].sum()
    with np.errstate(divide="ignore"):  # no error at all is infinitely good
        return float(10 * np.log10(np.square(wanted).sum() / noise)), order


def balance_score(truth: Image, balanced: Image, valid: Mask) -> tuple[float, float]:
    """Signal-to-noise ratio in dB after one scale for all, and median error of colour in degrees.

    truth, balanced: (H, W, 3) linear camera RGB. valid: (H, W). A colour's error is the angle
    between the two; a pixel without any light is 90° off. Raises ValueError for values that are
    not finite.
    """
    wanted, found = truth[valid].astype(np.float64), balanced[valid].astype(np.float64)
    if not np.isfinite(found).all():
        raise ValueError("the balanced picture holds values that are not finite")
    scale = (found * wanted).sum() / max(np.square(found).sum(), 1e-30)
    noise = np.square(scale * found - wanted).sum()
    with np.errstate(divide="ignore"):  # no error at all is infinitely good
        snr = float(10 * np.log10(np.square(wanted).sum() / noise))
    across = np.linalg.norm(np.cross(found, wanted), axis=1)
    along = (found * wanted).sum(axis=1)
    angles = np.where(found.any(axis=1), np.arctan2(across, along), np.pi / 2)
    return snr, float(np.degrees(np.median(angles)))


def coefficient_error_deg(truth: Floats64, found: Floats64, order: tuple[int, ...]) -> float:
    """Mean angle in degrees between the lamps' coefficients (N, 3) and those found.

    order: as joint_snr gives it. Hui et al. 2018, supplement, figure 4.
    """
    angles = [_angle(one, found[at]) for one, at in zip(truth, order, strict=True)]
    return float(np.degrees(np.mean(angles)))


def _angle(a: Floats64, b: Floats64) -> float:
    return float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))  # exact for small angles too

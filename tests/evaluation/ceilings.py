"""How well lamps could be separated if they were known, within what 3×3 matrices can express."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product

import numpy as np
from scipy.optimize import least_squares

from pipeline.arrays import Floats, Floats32, Floats64
from pipeline.images.frames import Image, Mask, Matrix
from pipeline.light.shares import shares
from pipeline.spectra.lights import reflectance_spectra
from tests.definitions.pixels import normalised
from tests.evaluation.scoring import joint_snr

Layers = Floats32

_WEIGHTINGS = (0.0, 0.5, 1.0)  # exponent: errors count as they are … relative to brightness
_FITTING, _ALTERNATING = 6, 12  # rounds
_PIXELS = 6000
_TUNING = 30  # rounds at most
_STEP = 1e-4  # of finite differences, relative
_DARK = 1e-3  # of the mean light, so that no pixel counts without bound


def dealt_out(photograph: Image, no_flash: Image, flash: Image, matrices: Matrix) -> Layers:
    """Layers (N, H, W, 3) of known lamps: the photograph (H, W, 3) in their proportions."""
    return np.asarray(proportions(no_flash, flash, matrices) * photograph, dtype=np.float32)


def proportions(no_flash: Image, flash: Image, matrices: Matrix) -> Layers:
    """Parts (N, H, W, 3) of known lamps in every channel, those of z_j T_j I_flash.

    z ≥ 0 by least squares in the image, each channel weighed by 1 ÷ its mean as in the pipeline.

    Parameters
    ----------
    no_flash, flash : (H, W, 3), photograph without the flash and flash part, noise filtered
    matrices : (N, 3, 3) T_j
    """
    z = _shares(no_flash, flash, matrices)
    return normalised(z[..., None] * _predictions(flash, matrices))


def regressed_matrices(sensitivities: Floats64, flash: Floats64, lamps: Floats64) -> Matrix:
    """Lamps known exactly: the best matrices (N, 3, 3) from the flash's light to each lamp's.

    They are regressed over the reflectances of the pipeline, not those of the scene, errors
    relative to brightness. sensitivities: (3, W). flash: (W,). lamps: (N, W) spectra.
    """
    rho = reflectance_spectra()
    before = rho @ (sensitivities * flash).T
    weight = 1.0 / before.sum(axis=1, keepdims=True)
    after = [rho @ (sensitivities * lamp).T for lamp in lamps]
    return np.stack(
        [np.linalg.lstsq(before * weight, one * weight, rcond=None)[0].T for one in after]
    )


def best_matrices(
    truth: Layers,
    flash_part: Image,
    photograph: Image,
    no_flash: Image,
    flash: Image,
    valid: Mask,
) -> Matrix:
    """Matrices (N, 3, 3) of the lamps whose dealt-out layers come nearest to the truth.

    For each of some weightings of bright against dark pixels, matrices are fitted in two ways to
    every lamp's light alone, then shares and matrices are improved by turns, all on light without
    noise and motion; the best joint SNR of the photographs' layers on the way wins. These matrices
    describe the lamps; tuned_matrices asks for the score alone.

    Parameters
    ----------
    truth, flash_part : (N, H, W, 3) and (H, W, 3), the light of every lamp and of the flash
    photograph : (H, W, 3), the photograph without the flash as it is
    no_flash, flash : as for proportions
    valid : (H, W), the pixels that count
    """
    raw, lit, x, wanted = _sample(truth, photograph, no_flash, flash, valid)
    seen = _sample(truth, photograph, no_flash, flash_part, valid)[2][0].astype(np.float64)
    lights = wanted[:, 0].astype(np.float64)
    everywhere = np.ones(raw.shape[:2], dtype=np.bool_)
    total = np.maximum(lights.sum(axis=(0, 2)), 0.0)
    best, highest = np.empty((len(truth), 3, 3)), -np.inf
    for power, start in product(_WEIGHTINGS, (_by_ratio, _by_direction)):
        matrices = np.stack([_alone(one, seen, power, start) for one in lights])
        weight = (total + _DARK * total.mean()) ** -power
        for _ in range(_ALTERNATING):
            layers = dealt_out(raw, lit, x, matrices)
            snr, _order = joint_snr(wanted, layers, everywhere)
            if snr > highest:
                best, highest = matrices, snr
            held = _shares(lights.sum(axis=0), seen, matrices)
            matrices = np.stack(
                [
                    _regress(share[:, None] * seen, one, weight)
                    for share, one in zip(held, lights, strict=True)
                ]
            )
    return best


def tuned_matrices(
    truth: Layers, photograph: Image, no_flash: Image, flash: Image, valid: Mask, start: Matrix
) -> Matrix:
    """Matrices (N, 3, 3) with the highest joint SNR of the dealt-out layers, whatever lamps are.

    Least squares on the layers themselves, shares and all, from start: the most that shares of N
    matrices can give, to within the search. The rest as for best_matrices.
    """
    raw, lit, x, wanted = _sample(truth, photograph, no_flash, flash, valid)

    def errors(values: Floats64) -> Floats64:
        layers = dealt_out(raw, lit, x, values.reshape(start.shape))
        return np.asarray((layers - wanted).ravel(), dtype=np.float64)

    unit = start / np.linalg.norm(start, axis=(1, 2), keepdims=True)
    found = least_squares(errors, unit.ravel(), diff_step=_STEP, max_nfev=_TUNING)
    return np.asarray(found.x.reshape(start.shape), dtype=np.float64)


def _sample(
    truth: Layers, photograph: Image, no_flash: Image, flash: Image, valid: Mask
) -> tuple[Image, Image, Image, Layers]:
    """Photograph, filtered pair (1, n, 3) and truth (N, 1, n, 3) in pixels spread over the valid.

    Matrices of a few numbers need no more of them.
    """
    pick = np.flatnonzero(valid)
    pick = pick[np.linspace(0, len(pick) - 1, min(len(pick), _PIXELS)).astype(np.intp)]
    raw, lit, x = (image.reshape(1, -1, 3)[:, pick] for image in (photograph, no_flash, flash))
    return raw, lit, x, truth.reshape(len(truth), 1, -1, 3)[:, :, pick]


def _alone(
    light: Floats64,
    flash: Floats64,
    power: float,
    start: Callable[[Floats64, Floats64, Floats64], Matrix],
) -> Matrix:
    """Matrix of one lamp, light ≈ z T flash with z of each pixel free: z and T by turns."""
    total = np.maximum(light.sum(axis=1), 0.0)
    weight = (total + _DARK * total.mean()) ** -power
    matrix = start(light, flash, weight)
    for _ in range(_FITTING):
        predicted = flash @ matrix.T
        square = np.square(predicted).sum(axis=1)
        z = (predicted * light).sum(axis=1) / np.maximum(square, _DARK**2 * square.mean())
        matrix = _regress(np.maximum(z, 0.0)[:, None] * flash, light, weight)
    return matrix


def _by_ratio(light: Floats64, flash: Floats64, weight: Floats64) -> Matrix:
    """First matrix from z = brightness of the light ÷ that of the flash."""
    strength = flash.sum(axis=1)
    z = light.sum(axis=1) / np.maximum(strength, _DARK * strength.mean())
    return _regress(np.maximum(z, 0.0)[:, None] * flash, light, weight)


def _by_direction(light: Floats64, flash: Floats64, weight: Floats64) -> Matrix:
    """First matrix from light × T flash = 0: both point the same way, which is linear in T."""
    across = np.square(light).sum(axis=1)[:, None, None] * np.eye(3)
    across -= light[:, :, None] * light[:, None, :]
    normal = np.einsum("p,pkm,pl,pn->klmn", weight**2, across, flash, flash, optimize=True)
    matrix = np.linalg.eigh(normal.reshape(9, 9))[1][:, 0].reshape(3, 3)
    # T and −T point alike; one of them gives light
    return np.asarray(matrix * np.sign(((flash @ matrix.T) * light).sum()))


def _regress(before: Floats64, after: Floats64, weight: Floats64) -> Matrix:
    w = weight[:, None]
    return np.asarray(np.linalg.lstsq(before * w, after * w, rcond=None)[0].T)


def _shares(no_flash: Floats, flash: Floats, matrices: Matrix) -> Layers:
    weight = (1.0 / np.maximum(no_flash.reshape(-1, 3).mean(axis=0), 1e-12)).astype(np.float32)
    return shares(no_flash * weight, _predictions(flash, matrices) * weight)


def _predictions(flash: Floats, matrices: Matrix) -> Layers:
    """T_j I_flash, (N, ..., 3), ≥ 0."""
    return np.stack([np.maximum(flash @ one.T.astype(np.float32), 0.0) for one in matrices])

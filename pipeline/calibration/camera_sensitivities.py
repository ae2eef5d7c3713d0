"""Spectral sensitivities of a camera from the patches of a ColorChecker."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Floats64
from pipeline.calibration.patches import Patches
from pipeline.calibration.posterior import best_scale, posterior, smooth, weights
from pipeline.errors import OptionError, UnusablePairError
from pipeline.spectra.cameras import Camera
from pipeline.spectra.wavelengths import STEP_NM

# standard deviations from a known camera (docs/decisions/0007-calibration.md)
_GAIN, _TINT, _TINT_REACH_NM = 0.2, 0.4, 40.0  # relative: of a whole channel, and along it
_TAIL, _TAIL_REACH_NM = 0.02, 30.0  # of the channel's peak
_SHIFT_NM = 2.0
_ROUNDS = 3  # of finding curves and the flash's fall-off by turns
_NO_CHART = 0.15  # relative error of the patches' light
_FAR_LIKELIER = 12.0  # log evidence, which right flashes of measured cameras stay below


@dataclass(frozen=True)
class CameraEstimate:
    """A camera as it was found.

    sensitivities: (3, W), the largest value 1. nearest: the name of the known camera that it is
    most like. flash: the name of the flash that was told or is the likeliest. misfit: relative
    error of the patches' light as the likeliest estimate predicts it, root mean square.
    """

    sensitivities: Floats64
    nearest: str
    flash: str
    misfit: float


def estimate_camera(
    patches: Patches, flashes: Mapping[str, Floats64], known: Sequence[Camera]
) -> CameraEstimate:
    """Estimate the sensitivities of a camera.

    flashes: (W,) spectra of what the flash may be, by name; one where it is known. known: cameras
    that it may resemble. A camera is a known one whose curves are scaled, tinted and shifted a
    little, with tails of their own. Which one, and which flash, is a matter of evidence, by which
    the estimates are averaged. Raises OptionError for flashes that no known camera sees in all its
    channels, UnusablePairError where no camera explains the patches.
    """
    found, evidence, names = [], [], []
    for flash, spectrum in flashes.items():
        for name, curves, likely in _tried(patches, spectrum, known):
            found.append(curves / curves.max())
            evidence.append(likely)
            names.append((flash, name))
    if not found:
        raise OptionError(
            "No known camera sees red, green and blue in the flash spectrum: check its wavelengths."
        )
    share = weights(evidence)
    sensitivities = np.tensordot(share, np.array(found), axes=1)
    best = int(np.argmax(evidence))
    flash, nearest = names[best]
    misfit = patches.misfit(_predicted(patches, flashes[flash], found[best]))
    if not misfit <= _NO_CHART:  # NaN neither
        raise UnusablePairError(
            f"No camera explains the patches' colours, which stay off by {misfit:.0%}: check the "
            "corners and the flash, and keep gloss and shadows off the patches."
        )
    return CameraEstimate(sensitivities / sensitivities.max(), nearest, flash, misfit)


def is_unlikely(
    flash: Floats64, patches: Patches, others: Iterable[Floats64], known: Sequence[Camera]
) -> bool:
    """Whether another flash explains the patches far better than the one that was told.

    Which one is not certain where the camera is unlike all that are known. flash, others: (W,)
    spectra. known: as for estimate_camera.
    """

    def likely(spectrum: Floats64) -> float:
        return max((found[2] for found in _tried(patches, spectrum, known)), default=-np.inf)

    return max(map(likely, others)) - likely(flash) > _FAR_LIKELIER


def _tried(
    patches: Patches, flash: Floats64, known: Sequence[Camera]
) -> Iterator[tuple[str, Floats64, float]]:
    """Name, curves (3, W) and log evidence about each known camera that sees the flash."""
    for camera in known:
        if (camera.sensitivities @ flash > 0).all():
            yield camera.name, *_of_member(patches, flash, camera.sensitivities)


def _of_member(patches: Patches, flash: Floats64, member: Floats64) -> tuple[Floats64, float]:
    """Estimate (3, W) about one known camera, and its log evidence."""
    seen_by = patches.reflectances * flash
    curves, evidence = member, 0.0
    for _ in range(_ROUNDS):
        scales = [
            best_scale(seen_by @ curves[k], patches.flash[:, k], patches.tolerance[:, k])
            for k in range(3)
        ]
        curves = curves * np.array(scales)[:, None]
        gain = patches.fall_off(seen_by @ curves.T)
        seen, variance = patches.flash / gain, patches.tolerance / gain**2
        found = []
        evidence = 0.0
        for k in range(3):
            mean = member[k] * best_scale(seen_by @ member[k], seen[:, k], variance[:, k])
            channel, likely = posterior(
                seen_by, seen[:, k], variance[:, k], mean, _covariance(mean)
            )
            found.append(np.maximum(channel, 0.0))
            evidence += likely
        curves = np.array(found)
    return curves, evidence


def _covariance(curve: Floats64) -> Floats64:
    slope = np.gradient(curve, STEP_NM)
    return np.asarray(
        np.outer(curve, curve) * (_GAIN**2 + _TINT**2 * smooth(_TINT_REACH_NM))
        + (_TAIL * curve.max()) ** 2 * smooth(_TAIL_REACH_NM)
        + _SHIFT_NM**2 * np.outer(slope, slope)
    )


def _predicted(patches: Patches, flash: Floats64, curves: Floats64) -> Floats64:
    even = patches.reflectances @ (curves * flash).T
    lit = even * patches.fall_off(even)
    scales = [best_scale(lit[:, k], patches.flash[:, k], patches.tolerance[:, k]) for k in range(3)]
    return np.asarray(lit * np.array(scales))

"""The spectrum of a flash from patches of known reflectance and a known camera."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Floats64
from pipeline.calibration.patches import Patches
from pipeline.calibration.posterior import best_scale, posterior, smooth, weights
from pipeline.errors import UnusablePairError
from pipeline.spectra.lights import packaged_light

FAMILY = (
    "xenon",
    "Kinoton 75P",
    "D50",
    "D65",
    "D75",
    *(f"LED-{name}" for name in ("B1", "B2", "B3", "B4", "B5", "BH1", "V1", "V2")),
    *(f"PHOS-{number}" for number in (1, 2, 3, 4)),
    "Phosphor LED YAG",
    "Luxeon WW 2880",
)
"""Measured lights that flashes are like: xenon tubes and lamps, daylight, white LEDs."""

# relative standard deviations from a known light (docs/decisions/0007-calibration.md)
_TINT, _REACH_NM, _STRENGTH = 0.15, 60.0, 0.5  # along the spectrum, and of the whole
_ROUNDS = 3  # of finding the spectrum and the flash's fall-off by turns
_NO_CHART = 0.15  # relative error of the patches' light


@dataclass(frozen=True)
class FlashEstimate:
    """A flash as it was found.

    spectrum: (W,) summing to 1. nearest: the name in FAMILY that explains the patches best.
    misfit: relative error of the patches' light as predicted with it, root mean square.
    """

    spectrum: Floats64
    nearest: str
    misfit: float


def estimate_flash(patches: Patches, sensitivities: Floats64) -> FlashEstimate:
    """Estimate the spectrum of the flash; sensitivities: (3, W) of the camera.

    A flash is a light of FAMILY with a smooth tint. Which one is a matter of evidence, by which
    the members' estimates are averaged. Raises UnusablePairError where no flash explains the
    patches.
    """
    found, evidence = [], []
    for name in FAMILY:
        spectrum, likely = _of_member(patches, sensitivities, packaged_light(name))
        found.append(spectrum / spectrum.sum())
        evidence.append(likely)
    spectrum = weights(evidence) @ np.array(found)
    misfit = patches.misfit(_predicted(patches, sensitivities, spectrum))
    if not misfit <= _NO_CHART:  # NaN neither
        raise UnusablePairError(
            f"No flash explains the patches' colours, which stay off by {misfit:.0%}: check the "
            "marks and the camera, and keep gloss and shadows off the patches."
        )
    return FlashEstimate(spectrum, FAMILY[int(np.argmax(evidence))], misfit)


def log_evidence(patches: Patches, sensitivities: Floats64) -> float:
    """Log evidence of the likeliest light of FAMILY for what a camera (3, W) saw of the patches."""
    return max(_of_member(patches, sensitivities, packaged_light(name))[1] for name in FAMILY)


def _of_member(patches: Patches, s: Floats64, member: Floats64) -> tuple[Floats64, float]:
    """Estimate (W,) about one member of the family, and its log evidence."""
    spectrum, evidence = member, 0.0
    seen_by = (patches.reflectances[:, None] * s).reshape(-1, s.shape[1])
    for _ in range(_ROUNDS):
        gain = patches.fall_off(patches.reflectances @ (s * spectrum).T)
        seen = (patches.flash / gain).ravel()
        variance = (patches.tolerance / gain**2).ravel()
        mean = member * best_scale(seen_by @ member, seen, variance)
        covariance = np.outer(mean, mean) * (_TINT**2 * smooth(_REACH_NM) + _STRENGTH**2)
        likeliest, evidence = posterior(seen_by, seen, variance, mean, covariance)
        spectrum = np.maximum(likeliest, 0.0)
    return spectrum, evidence


def _predicted(patches: Patches, s: Floats64, spectrum: Floats64) -> Floats64:
    even = patches.reflectances @ (s * spectrum).T
    lit = even * patches.fall_off(even)
    scale = best_scale(lit.ravel(), patches.flash.ravel(), patches.tolerance.ravel())
    return np.asarray(lit * scale)

"""The spectrum of a lamp, as far as its matrix tells.

Linear minimum mean square error (Wiener) estimation of spectra from camera responses, as in
Shimano, "Recovery of spectral reflectances of objects being imaged without prior knowledge", IEEE
Trans. Image Processing 15(7), 2006; here of a light, from the nine values of its matrix. For its
own colour, brought by least relative entropy (Kullback and Leibler 1951) to what the camera sees.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Floats64
from pipeline.images.frames import Matrix
from pipeline.spectra.lights import lamp_spectra
from pipeline.spectra.matrices import by_spectrum

_WHITE_OFF, _ACROSS_OFF = 0.03, 0.1
"""How far a fitted matrix is off: on white surfaces, and on colours, which say less of it."""
_LEAST = 0.01  # of the mean lamp, at every wavelength
_USUAL_OFF = 0.02
"""How far a white lamp's estimate is off what the camera sees, relative, and better than that;
chosen on development lamps (docs/trials/lamp_colours.md)."""
_RIDGE = 1e-4  # of a card of sum 1, so that the search ends at colours that no light has, too
_STEPS, _ENOUGH = 100, 1e-6


@dataclass(frozen=True)
class SpectrumPrior:
    """What spectra lamps have, before and after their matrix is known.

    mean: (W,) of measured lamps whose matrix gives a white card channels that sum to 1. expected:
    (9,) vec T of it. gain: (W, 9), vec T − expected → spectrum − mean. flash_white: (3,) a white
    card's colour under the flash. sensitivities: (3, W).
    """

    mean: Floats64
    expected: Floats64
    gain: Floats64
    flash_white: Floats64
    sensitivities: Floats64

    def spectrum(self, matrix: Matrix) -> Floats64:
        """Spectrum (W,), positive, of a lamp of matrix T (3, 3), flash part → lamp, of any scale.

        The mean of measured lamps where T gives a white card no light.
        """
        light = float((matrix @ self.flash_white).sum())
        if light <= 0:
            return self.mean
        off = matrix.ravel() / light - self.expected
        return np.asarray(np.maximum(self.mean + self.gain @ off, _LEAST * self.mean))

    def coloured(self, matrix: Matrix) -> Floats64:
        """As spectrum, (W,), with the colour that the camera sees of it, as far as it is not usual.

        Measured lamps are white, and so is what is estimated of a lamp with a gel or of one colour.
        """
        seen = np.maximum(matrix @ self.flash_white, 0.0)
        estimate = self.spectrum(matrix)
        if not seen.sum() > 0:
            return estimate
        card = self.sensitivities @ estimate
        off = seen * (card.sum() / seen.sum()) - card
        unusual = (off @ off) / (off @ off + _USUAL_OFF**2 * (card @ card))
        return _with_card(estimate, self.sensitivities, card + unusual * off)


def learn_spectra(sensitivities: Floats64, flash: Floats64) -> SpectrumPrior:
    """Learn what spectra lamps have. sensitivities: (3, W). flash: (W,), its spectrum."""
    white = sensitivities @ flash
    to_matrix = by_spectrum(sensitivities, sensitivities * flash)
    known = lamp_spectra()
    known = known / (known @ (white @ to_matrix.sum(axis=0)))[:, None]
    to_matrix = to_matrix.reshape(9, -1)
    mean = known.mean(axis=0)
    off = known - mean
    covariance = off.T @ off / len(known)
    expected = to_matrix @ mean
    along = np.outer(white, white) / (white @ white)
    noise = _WHITE_OFF**2 * along + _ACROSS_OFF**2 * (np.eye(3) - along)
    noise = np.kron(np.eye(3), noise) * (expected @ expected) / 3
    told = to_matrix @ covariance
    gain = np.linalg.solve(told @ to_matrix.T + noise, told).T
    return SpectrumPrior(mean, expected, gain, white, sensitivities)


def _with_card(spectrum: Floats64, sensitivities: Floats64, card: Floats64) -> Floats64:
    """Spectrum (W,) of least relative entropy to another that gives a white card a colour (3,).

    That is the other times exp(a @ sensitivities), positive everywhere; a by Newton's method.
    """
    a = np.zeros(3)
    found = spectrum
    for _ in range(_STEPS):
        slope = sensitivities @ found - card + _RIDGE * a
        bend = (sensitivities * found) @ sensitivities.T + _RIDGE * np.eye(3)
        step = np.linalg.solve(bend, slope)
        most = np.abs(step @ sensitivities).max()
        a -= step / max(most, 1.0)  # farther than a factor of e its parabola says nothing
        found = spectrum * np.exp(a @ sensitivities)
        if most < _ENOUGH:
            break
    return np.asarray(found)

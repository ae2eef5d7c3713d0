"""What light a lamp of known colour may give by that of the flash.

A bank of lamps, each brought to the colour that the lamp has on a grey card, says what matrix takes
the flash part to the lamp's light, how far it may be off, and how far surfaces of one kind may.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats64
from pipeline.spectra.lights import lamp_spectra, packaged_light, reflectance_spectra
from pipeline.vectors import unit

_BROAD = ("D50", "D65", "D75", "A", "E", "FL7", "LED-B1", "LED-B5")  # lights put behind filters
_FILTERED = ((1, 0.05), (2, 0.025))  # passes through a reflectance as a filter, weight
_BANDWIDTHS = tuple(np.geomspace(0.01, 0.3, 18))  # distances of unit colours, until there are
_ENOUGH = 12.0  # lamps of like colour
_GREY_CARD = 30.0  # times the weight of a reflectance, as the colour is known on it
_SLACK = 0.03  # relative: by which a lamp may be unlike all of the bank
_WIDER, _MATERIAL_WIDER = 3.0, 10.0  # times the deviations within the bank
_STRENGTH, _COLOUR = 0.5, 0.1  # relative: what is given may be off by so much
_MODES = 6  # the strongest of nine
_LEAST = 1e-3  # of the strongest channel


@dataclass(frozen=True)
class ResponsePrior:
    """What a lamp's matrix may be: mean + Σ_k a_k modes[k], a ~ N(0, 1), plus each material's own.

    mean: (3, 3), flash part → light of the lamp. modes: (k, 3, 3). material: (3, 3), whitened
    deviation of a material → its light by the flash part's sum of channels. found: (k,) of the
    modes where the matrix is as layers were separated by, 0 without one.
    """

    mean: Floats64
    modes: Floats64
    material: Floats64
    found: Floats64


def floored(colours: Floats64) -> Floats64:
    """Colours (..., 3), each channel at least a thousandth of the colour's largest."""
    return np.asarray(np.maximum(colours, _LEAST * colours.max(axis=-1, keepdims=True)))


class LampBank:
    """Lamps and what reflectances look like under them, seen by one camera."""

    def __init__(self, sensitivities: Floats64, flash: Floats64) -> None:
        """sensitivities: (3, W). flash: (W,) spectrum."""
        rho = reflectance_spectra()
        self.flash_white = sensitivities @ flash / (sensitivities[1] @ flash)
        by_flash = rho @ (sensitivities * flash).T / (sensitivities[1] @ flash)
        self._scale = 1.0 / by_flash.sum(axis=1)
        rows = np.concatenate(
            [
                by_flash * self._scale[:, None],
                _GREY_CARD * self.flash_white[None] / self.flash_white.sum(),
            ]
        )
        self._rows = rows
        self._solve = np.linalg.pinv(rows)
        measured = lamp_spectra()
        broad = np.array([packaged_light(name) for name in _BROAD])
        spectra, weights = [measured], [np.ones(len(measured))]
        for power, weight in _FILTERED:
            passed = (broad[:, None] * rho[None] ** power).reshape(-1, rho.shape[1])
            spectra.append(passed)
            weights.append(np.full(len(passed), weight))
        lights = np.concatenate(spectra)
        self._weights = np.concatenate(weights)
        self._whites = lights @ sensitivities.T
        seen = self._whites.min(axis=1) > _LEAST * self._whites.max(axis=1)
        lights, self._weights, self._whites = lights[seen], self._weights[seen], self._whites[seen]
        # (lamps, reflectances, 3)
        self._seen = np.einsum("lw,rw,kw->lrk", lights, rho, sensitivities, optimize=True)

    def prior(
        self, colour: Floats64, measured: bool = True, separated: Floats64 | None = None
    ) -> ResponsePrior:
        """Learn the prior of a lamp from its colour (3,) on a grey card, scaled to its strength.

        measured: whether the colour was; else it may be off, too. separated: (3, 3), the lamp's
        matrix by which layers were separated, of any scale.
        """
        colour = floored(colour)
        like, weights = self._alike(colour)
        gains = colour / self._whites[like]
        light = self._seen[like] * gains[:, None, :] * self._scale[None, :, None]
        card = np.broadcast_to(_GREY_CARD * colour / self.flash_white.sum(), (len(gains), 1, 3))
        target = np.concatenate([light, card], axis=1)
        matrices = np.einsum("jr,lrk->lkj", self._solve, target)
        mean = np.einsum("l,lkj->kj", weights, matrices)
        off = (matrices - mean).reshape(len(matrices), 9)
        covariance = (off * weights[:, None]).T @ off
        slack = (_SLACK * np.linalg.norm(colour) / np.linalg.norm(self.flash_white)) ** 2
        u = self.flash_white / np.linalg.norm(self.flash_white)
        covariance += slack * np.kron(np.eye(3), np.eye(3) - np.outer(u, u))
        values, vectors = np.linalg.eigh(covariance)
        strongest = np.argsort(values)[::-1][:_MODES]
        modes = (
            _WIDER * np.sqrt(np.maximum(values[strongest], 0))[:, None] * vectors[:, strongest].T
        )
        residual = (target - np.einsum("rj,lkj->lrk", self._rows, matrices))[:, :-1]
        spread = np.einsum("l,lrk,lri->ki", weights, residual, residual) / residual.shape[1]
        values, vectors = np.linalg.eigh(spread)
        material = _MATERIAL_WIDER * vectors * np.sqrt(np.maximum(values, 0))
        modes = np.concatenate([modes.reshape(-1, 3, 3), _STRENGTH * mean[None]])
        if not measured:
            channels = _COLOUR * np.eye(3)[:, :, None] * mean
            modes = np.concatenate([modes, channels])
        found = np.zeros(len(modes))
        if separated is not None:
            found = self._modes_at(separated, mean, modes)
        return ResponsePrior(mean, modes, material, found)

    def _modes_at(self, matrix: Floats64, mean: Floats64, modes: Floats64) -> Floats64:
        """The likeliest modes (k,) of a lamp that was found to have this matrix (3, 3)."""
        bright = (mean @ self.flash_white).sum() / (matrix @ self.flash_white).sum()
        by_mode = modes.reshape(len(modes), 9).T / (_SLACK * np.abs(mean).max())
        off = (bright * matrix - mean).ravel() / (_SLACK * np.abs(mean).max())
        return np.asarray(
            np.linalg.solve(by_mode.T @ by_mode + np.eye(len(modes)), by_mode.T @ off)
        )

    def _alike(self, colour: Floats64) -> tuple[NDArray[np.intp], Floats64]:
        """Lamps of like colour, and their weights, which sum to 1."""
        distance = np.linalg.norm(unit(self._whites) - colour / np.linalg.norm(colour), axis=1)
        weights = self._weights
        for bandwidth in _BANDWIDTHS:
            weights = self._weights * np.exp(-((distance / bandwidth) ** 2) / 2)
            if weights.sum() ** 2 > _ENOUGH * max((weights**2).sum(), 1e-300):
                break
        like = np.flatnonzero(weights > 1e-4 * weights.max())
        return like, weights[like] / weights[like].sum()

"""The photograph as another camera would have seen it, and each lamp's layer."""

from __future__ import annotations

import numpy as np

from pipeline.arrays import Floats32, Floats64
from pipeline.images.frames import Image
from pipeline.lamps.lamps import Lamps
from pipeline.light.model import Model, Response
from pipeline.options import Method
from pipeline.spectra.matrices import best_matrix


def camera_changes(lamps: Lamps, model: Model, response: Response, method: Method) -> Floats64:
    """Matrices (N, 3, 3), a lamp's layer → the same through the other camera.

    paper: T'_j T_j⁻¹, so that a layer T_j I_f z_j becomes T'_j I_f z_j, with T' of the other
    camera's model (Hui et al. 2018, supplement, camera response editing, fig. 13). best: what fits
    measured reflectances best under the spectrum that the lamp has by its matrix. Neither needs a
    flash part, so that they work in every pixel.
    """
    if method == "paper":
        matrices = np.einsum("klj,nj->nkl", response.tensor, lamps.coefficients)
        # by least squares: a lamp that lacks a colour has no sound inverse
        return np.asarray(matrices @ np.linalg.pinv(lamps.matrices, rcond=1e-3))
    here, there = model.camera.sensitivities, response.sensitivities
    spectra = [model.lamp_spectra.spectrum(matrix) for matrix in lamps.matrices]
    return np.stack([best_matrix(here * one, there * one) for one in spectra])


def other_response(layers: Floats32, changes: Floats64) -> Image:
    """Layers (N, h, W, 3) through the other camera, summed; (h, W, 3), its linear RGB.

    changes: (N, 3, 3) from camera_changes.
    """
    seen = (
        layer @ change.T.astype(np.float32) for layer, change in zip(layers, changes, strict=True)
    )
    return np.asarray(sum(seen), dtype=np.float32)

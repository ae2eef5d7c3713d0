"""The model of a camera under a flash: a few small matrices, and all that separation needs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Floats, Floats64
from pipeline.errors import OptionError
from pipeline.hui2018.invariant import flash_tensor
from pipeline.images.frames import Matrix
from pipeline.light.families import FamilyBank, learn_families
from pipeline.light.lamp_spectrum import SpectrumPrior, learn_spectra
from pipeline.light.prior import MatrixPrior, learn_prior
from pipeline.spectra.bases import SpectralBasis, learn_basis
from pipeline.spectra.cameras import Camera, tells_colours_apart
from pipeline.spectra.colorimetry import camera_to_xyz
from pipeline.spectra.families import family_spectra
from pipeline.spectra.lights import lamp_spectra, packaged_light, reflectance_spectra
from pipeline.spectra.matrices import balancing_matrix, best_matrix
from pipeline.spectra.observer import cie_1931

_DISPLAY_LIGHT = "D65"
"""White of sRGB and Rec. 2020: photographs are shown as balanced for it."""
_MOST_CONDITION = 1e6  # of what a camera sees under the neutral light; lamps have 70 and less
_MOST_FLASH_CONDITION = 100  # under the flash; lamps have 66 and less, lines far more


@dataclass(frozen=True)
class Response:
    """Another camera, exposed so that its green response to D65 is that of the first.

    tensor: (3, 3, 3) D with I_lamp, as the other camera sees it, = z · (Σ_j b_j D[:, :, j]) I_flash
    of the first. sensitivities: (3, W). camera_to_xyz: (3, 3) the other camera's RGB → CIE XYZ
    under D65.
    """

    tensor: Floats64
    sensitivities: Floats64
    camera_to_xyz: Matrix


@dataclass(frozen=True)
class Model:
    """How a camera sees lights by the light of the flash.

    Lights are written as coefficients b (3,), in coordinates where b is the camera RGB of a white
    card (docs/decisions/0002-light-coordinates.md).

    flash: (W,) spectrum, on any scale. lamp_spectra: what spectrum a lamp has by its matrix.
    tensor: (3, 3, 3) D, with I_lamp = z · (Σ_j b_j D[:, :, j]) I_flash.
    published: (3, 3) coefficients b → the published coordinates (SpectralBasis.published).
    prior: what the matrices T of lamps may be. families: those of lamps of each family.
    flash_white: (3,) camera RGB of a white card under the flash, green 1.
    neutral: (3,) coefficients of the neutral light, green 1.
    neutral_light: (W,) its spectrum, which gives a white card green 1.
    flash_to_neutral: (3, 3) best matrix from I_flash to the same under the neutral light that
        keeps white: a white card gets the neutral light's own colour, green 1.
    camera_to_xyz: (3, 3) camera RGB → CIE XYZ for showing photographs as they are, learnt under
        D65; a white card of green 1 has Y = 1.
    neutral_to_xyz: the same learnt under the neutral light, whose own colour it keeps.
    response: another camera on the same scene, None where none was asked for.
    """

    camera: Camera
    flash: Floats64
    lamp_spectra: SpectrumPrior
    tensor: Floats64
    published: Matrix
    prior: MatrixPrior
    families: FamilyBank
    flash_white: Floats64
    neutral: Floats64
    neutral_light: Floats64
    flash_to_neutral: Matrix
    camera_to_xyz: Matrix
    neutral_to_xyz: Matrix
    response: Response | None

    def lamp_matrix(self, coefficients: Floats) -> Matrix:
        """Return T (3, 3) of a lamp (3,), or (N, 3, 3) of lamps (N, 3): I_lamp = z · T I_flash."""
        return np.asarray(np.einsum("klj,...j->...kl", self.tensor, coefficients))

    def lamp_white(self, matrix: Matrix) -> Floats64:
        """CIE XYZ (3,) of a white card under a lamp of T (3, 3), both of any scale, T of any sign.

        By the spectrum that the lamp has by its matrix, since camera_to_xyz holds for daylight; of
        a picture rendered to sRGB by camera_to_xyz all the same: its curve bends matrices.
        """
        seen = matrix @ self.flash_white
        if seen.sum() < 0:  # chromaticities do not tell T from −T
            matrix, seen = -matrix, -seen
        if self.camera.in_srgb:
            return self.camera_to_xyz @ np.maximum(seen, 0.0)
        return np.asarray(cie_1931() @ self.lamp_spectra.coloured(matrix))


def build_model(
    camera: Camera, flash: Floats64, neutral: Floats64, basis: str, response: Camera | None = None
) -> Model:
    """Learn the model from measured lamps and reflectances.

    flash, neutral: (W,) spectra on WAVELENGTHS_NM; basis: "wpca", "pca" or "joint"; response: the
    camera through which the photograph is to be seen anew. Raises OptionError for a camera that
    does not tell three colours apart, nor under one of the lights, or does not see one of them.
    """
    for one in (camera, *([] if response is None else [response])):
        _check_camera(one, flash, neutral)
    s = camera.sensitivities
    power = flash / (s @ flash)[1]
    learnt = learn_basis(basis, s, reflectance_spectra(), lamp_spectra())
    neutral_white = s @ neutral
    b_neutral = learnt.to_coefficients @ neutral
    tensor = flash_tensor(learnt.tensor(s), learnt.to_coefficients @ power)
    prior = learn_prior(tensor, _lamp_matrices(s, power, lamp_spectra()))
    of_families = {
        family: _lamp_matrices(s, power, spectra) for family, spectra in family_spectra().items()
    }
    return Model(
        camera=camera,
        flash=flash,
        lamp_spectra=learn_spectra(s, power),
        tensor=tensor,
        published=learnt.published,
        prior=prior,
        families=learn_families(prior, of_families, s @ power, camera.approximate),
        flash_white=s @ power,
        neutral=b_neutral / b_neutral[1],
        neutral_light=neutral / neutral_white[1],
        flash_to_neutral=balancing_matrix(s * power, s * neutral / neutral_white[1]),
        camera_to_xyz=_shown(s, packaged_light(_DISPLAY_LIGHT)),
        neutral_to_xyz=_shown(s, neutral),
        response=None if response is None else _response(learnt, s, power, response),
    )


def _check_camera(camera: Camera, flash: Floats64, neutral: Floats64) -> None:
    if not tells_colours_apart(camera.sensitivities):
        raise OptionError(
            f"The camera {camera.name!r} does not tell three colours apart: check the columns of "
            "its table."
        )
    for light, name in ((flash, "flash spectrum"), (neutral, "neutral light")):
        if not (camera.sensitivities @ light)[1] > 0:
            raise OptionError(
                f"The camera {camera.name!r} sees no green in the {name}: check the wavelengths "
                "of both."
            )
    if not np.linalg.cond(camera.sensitivities * neutral) < _MOST_CONDITION:
        raise OptionError(
            f"Under the neutral light the camera {camera.name!r} does not tell three colours "
            "apart: choose a light of more wavelengths, such as D65 or A."
        )
    if not np.linalg.cond(camera.sensitivities * flash) < _MOST_FLASH_CONDITION:
        raise OptionError(
            f"Under the flash spectrum the camera {camera.name!r} does not tell three colours "
            "apart: check the spectrum, or use a flash of more wavelengths."
        )


def _response(basis: SpectralBasis, s: Floats64, flash: Floats64, response: Camera) -> Response:
    other = response.sensitivities
    daylight = packaged_light(_DISPLAY_LIGHT)
    other = other * ((s @ daylight)[1] / (other @ daylight)[1])
    coefficients = basis.to_coefficients @ flash
    return Response(
        tensor=flash_tensor(basis.tensor(s), coefficients, seen_by=basis.tensor(other)),
        sensitivities=other,
        camera_to_xyz=_shown(other, daylight),
    )


def _lamp_matrices(s: Floats64, flash: Floats64, lamps: Floats64) -> Floats64:
    """Best matrices (m, 3, 3) from the flash to each lamp (m, W)."""
    return np.stack([best_matrix(s * flash, s * lamp) for lamp in lamps])


def _shown(s: Floats64, light: Floats64) -> Matrix:
    """Camera RGB under a light → XYZ, a white card of green 1 giving Y = 1."""
    return camera_to_xyz(s, light, reflectance_spectra()) * float((s @ light)[1])

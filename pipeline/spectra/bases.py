"""Three-dimensional bases of reflectances and lights, and the model tensor they give.

Source: Hui, Sunkavalli, Hadap, Sankaranarayanan, CVPR 2018, supplement section 3.1; joint
learning: Chong, Gortler, Zickler, "The von Kries hypothesis and a basis for color constancy",
ICCV 2007.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_JOINT_ROUNDS = 30


@dataclass(frozen=True)
class SpectralBasis:
    """Bases of what the method knows about spectra.

    reflectances: (3, W) ρ̃_i. lights: (3, W) ℓ̃_j, in coordinates such that a light's coefficients
    are the camera RGB of the perfect white under it (docs/decisions/0002-light-coordinates.md).
    to_coefficients: (3, W), spectrum of a light → its three coefficients.
    """

    reflectances: Array
    lights: Array
    to_coefficients: Array

    def tensor(self, sensitivities: Array) -> Array:
        """Model E (3, 3, 3) of a camera (3, W): E[k, i, j] = ∫ ρ̃_i S^k ℓ̃_j dλ."""
        return np.asarray(np.einsum("iw,kw,jw->kij", self.reflectances, sensitivities, self.lights))


def learn_basis(
    kind: str, sensitivities: Array, reflectances: Array, lights: Array
) -> SpectralBasis:
    """Learn the bases from measured spectra.

    Parameters
    ----------
    kind : "wpca", "pca" or "joint"
    sensitivities : (3, W) camera sensitivities, R, G, B
    reflectances : (m, W), 0…1
    lights : (n, W), any scale: each is scaled to unit sum

    A light's coefficients are those whose predicted camera responses to the training
    reflectances come nearest to the light's own, so that what is kept is what the camera sees.
    """
    lights = lights / lights.sum(1, keepdims=True)
    learn = {"pca": _pca, "wpca": _weighted_pca, "joint": _joint}[kind]
    reflectance_basis, light_basis = learn(sensitivities, reflectances, lights)
    tensor = np.einsum("iw,kw,jw->kij", reflectance_basis, sensitivities, light_basis)

    # responses of channel k to reflectance r under light l: (r∘S^k)·l, stacked over (r, k)
    stacked = (reflectances[:, None, :] * sensitivities[None]).reshape(-1, reflectances.shape[1])
    to_coefficients = np.linalg.lstsq(stacked @ light_basis.T, stacked, rcond=None)[0]
    to_white = np.einsum("i,kij->kj", _white(tensor, sensitivities, lights, light_basis), tensor)
    return SpectralBasis(
        reflectance_basis, np.linalg.inv(to_white).T @ light_basis, to_white @ to_coefficients
    )


def _pca(_: Array, reflectances: Array, lights: Array) -> tuple[Array, Array]:
    return _principal(reflectances), _principal(lights)


def _weighted_pca(s: Array, reflectances: Array, lights: Array) -> tuple[Array, Array]:
    """Per channel the leading singular vector of the spectra weighted by S^k, orthogonalised."""

    def one(spectra: Array) -> Array:
        leading = np.stack([_principal(spectra * channel, 1)[0] for channel in s])
        q, r = np.linalg.qr(leading.T)
        return np.asarray((q * np.sign(np.diag(r))).T)

    return one(reflectances), one(lights)


def _joint(s: Array, reflectances: Array, lights: Array) -> tuple[Array, Array]:
    """Alternate between the two bases so that the image intensities rᵀS^k l are preserved."""
    _, light_basis = _weighted_pca(s, reflectances, lights)
    reflectance_basis = light_basis
    for _round in range(_JOINT_ROUNDS):
        reflectance_basis = _given_the_other(s, reflectances, light_basis)
        light_basis = _given_the_other(s, lights, reflectance_basis)
    return reflectance_basis, light_basis


def _given_the_other(s: Array, spectra: Array, other: Array) -> Array:
    """Three-dimensional basis of spectra that best keeps their responses to S^k ∘ other_j."""
    probes = (s[:, None, :] * other[None]).reshape(-1, s.shape[1])
    scores = np.linalg.svd(spectra @ probes.T, full_matrices=False)[0][:, :3]
    q, _ = np.linalg.qr(np.linalg.lstsq(scores, spectra, rcond=None)[0].T)
    return np.asarray(q.T)


def _principal(spectra: Array, count: int = 3) -> Array:
    """Leading right singular vectors (count, W), each with a positive sum."""
    vectors = np.linalg.svd(spectra, full_matrices=False)[2][:count]
    signs = np.where(vectors.sum(1, keepdims=True) < 0, -1.0, 1.0)
    return np.asarray(vectors * signs)


def _white(tensor: Array, s: Array, lights: Array, light_basis: Array) -> Array:
    """Coefficients of ρ = 1 that best predict its camera colour under the training lights."""
    coefficients = np.linalg.lstsq(light_basis.T, lights.T, rcond=None)[0]
    predicted = np.einsum("kij,jn->nki", tensor, coefficients).reshape(-1, 3)
    return np.asarray(np.linalg.lstsq(predicted, (lights @ s.T).ravel(), rcond=None)[0])

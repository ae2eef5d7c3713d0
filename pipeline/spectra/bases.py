"""Three-dimensional bases of reflectances and lights, and the model tensor they give.

Source: Hui, Sunkavalli, Hadap, Sankaranarayanan, CVPR 2018, supplement section 3.1; joint
learning: Chong, Gortler, Zickler, "The von Kries hypothesis and a basis for color constancy",
ICCV 2007; De Lathauwer, De Moor, Vandewalle, "On the best rank-1 and rank-(R1, R2, …, RN)
approximation of higher-order tensors", 2000.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Floats64

_JOINT_ROUNDS, _JOINT_GAIN = 200, 1e-12  # at most so many; less than this is no gain


@dataclass(frozen=True)
class SpectralBasis:
    """Bases of what the method knows about spectra.

    reflectances: (3, W) ρ̃_i. lights: (3, W) ℓ̃_j, in coordinates such that a light's coefficients
    are the camera RGB of the perfect white under it (docs/decisions/0002-light-coordinates.md).
    to_coefficients: (3, W), spectrum of a light → its three coefficients.
    published: (3, 3), these coefficients → those in an orthonormal basis of the same space, the
    coordinates of the source; angles between lights, hence its histogram, its line and its
    triangle, depend on them.
    """

    reflectances: Floats64
    lights: Floats64
    to_coefficients: Floats64
    published: Floats64

    def tensor(self, sensitivities: Floats64) -> Floats64:
        """Model E (3, 3, 3) of a camera (3, W): E[k, i, j] = ∫ ρ̃_i S^k ℓ̃_j dλ."""
        return np.asarray(np.einsum("iw,kw,jw->kij", self.reflectances, sensitivities, self.lights))


def learn_basis(
    kind: str, sensitivities: Floats64, reflectances: Floats64, lights: Floats64
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
    published = np.linalg.inv(to_white)
    return SpectralBasis(
        reflectance_basis, published.T @ light_basis, to_white @ to_coefficients, published
    )


def _pca(_: Floats64, reflectances: Floats64, lights: Floats64) -> tuple[Floats64, Floats64]:
    return _principal(reflectances), _principal(lights)


def _weighted_pca(
    s: Floats64, reflectances: Floats64, lights: Floats64
) -> tuple[Floats64, Floats64]:
    """Per channel the leading singular vector of the spectra weighted by S^k, orthogonalised."""

    def one(spectra: Floats64) -> Floats64:
        leading = np.stack([_principal(spectra * channel, 1)[0] for channel in s])
        return _orthonormal(leading)

    return one(reflectances), one(lights)


def _joint(s: Floats64, reflectances: Floats64, lights: Floats64) -> tuple[Floats64, Floats64]:
    """Bases in which the image intensities rᵀ S^k l are best preserved.

    The measurement tensor M[k, m, n] of reflectance m under light n is brought as near as
    possible, by least squares, to one of rank 3 in its reflectances and 3 in its lights, by
    orthogonal iteration on the two factors A, B (De Lathauwer et al. 2000). With the bases
    ρ̃ = Aᵀ R and ℓ̃ = Bᵀ L, E^k(i, j) is the best core there is, so that no other bases of three
    dimensions keep the intensities better. Chong et al. ask for a diagonal core as well, for a
    diagonal colour constancy, which separation does not need. Orthonormal bases are returned.
    """
    measured = np.einsum("mw,kw,nw->kmn", reflectances, s, lights)
    of_light = np.linalg.svd(_unfolded(measured, 2), full_matrices=False)[0][:, :3]
    of_reflectance, kept = of_light, 0.0
    for _round in range(_JOINT_ROUNDS):
        by_light = np.einsum("kmn,nj->kmj", measured, of_light)
        of_reflectance = np.linalg.svd(_unfolded(by_light, 1), full_matrices=False)[0][:, :3]
        by_reflectance = np.einsum("kmn,mi->kin", measured, of_reflectance)
        of_light, values, _ = np.linalg.svd(_unfolded(by_reflectance, 2), full_matrices=False)
        of_light = of_light[:, :3]
        before, kept = kept, float(np.square(values[:3]).sum())
        if kept - before <= _JOINT_GAIN * kept:
            break
    return _orthonormal(of_reflectance.T @ reflectances), _orthonormal(of_light.T @ lights)


def _unfolded(tensor: Floats64, axis: int) -> Floats64:
    """Matrix of a tensor, one row for each index of the axis."""
    return np.moveaxis(tensor, axis, 0).reshape(tensor.shape[axis], -1)


def _orthonormal(rows: Floats64) -> Floats64:
    """Orthonormal rows that span the same space."""
    q, r = np.linalg.qr(rows.T)
    return np.asarray((q * np.where(np.diag(r) < 0, -1.0, 1.0)).T)


def _principal(spectra: Floats64, count: int = 3) -> Floats64:
    """Leading right singular vectors (count, W), each with a positive sum."""
    vectors = np.linalg.svd(spectra, full_matrices=False)[2][:count]
    signs = np.where(vectors.sum(1, keepdims=True) < 0, -1.0, 1.0)
    return np.asarray(vectors * signs)


def _white(tensor: Floats64, s: Floats64, lights: Floats64, light_basis: Floats64) -> Floats64:
    """Coefficients of ρ = 1 that best predict its camera colour under the training lights."""
    coefficients = np.linalg.lstsq(light_basis.T, lights.T, rcond=None)[0]
    predicted = np.einsum("kij,jn->nki", tensor, coefficients).reshape(-1, 3)
    return np.asarray(np.linalg.lstsq(predicted, (lights @ s.T).ravel(), rcond=None)[0])

from __future__ import annotations

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.hui2018.invariant import flash_tensor
from pipeline.spectra.bases import SpectralBasis, learn_basis
from pipeline.spectra.cameras import Camera
from pipeline.spectra.lights import find_light, lamp_spectra, reflectance_spectra
from tests.angles import angles

KINDS = ("wpca", "pca", "joint")


@pytest.fixture(scope="module", params=KINDS)
def basis(request: pytest.FixtureRequest, camera: Camera) -> SpectralBasis:
    return learn_basis(request.param, camera.sensitivities, reflectance_spectra(), lamp_spectra())


def test_coefficients_of_a_light_are_the_camera_colour_of_white(
    basis: SpectralBasis, camera: Camera
) -> None:
    """Nearly so for every lamp learnt from, so that coefficients can be read as colours."""
    errors = [
        angles(basis.to_coefficients @ light, camera.sensitivities @ light)
        for light in lamp_spectra()
    ]

    assert np.median(errors) < 2.5
    assert max(errors) < 8


def test_coefficients_are_on_the_scale_of_the_camera(basis: SpectralBasis, camera: Camera) -> None:
    for name in ("A", "D50", "D65", "FL2"):
        light = 5.0 * find_light(name)
        green = (camera.sensitivities @ light)[1]

        assert (basis.to_coefficients @ light)[1] == pytest.approx(green, rel=0.06)


def test_coefficients_of_spectra_in_the_basis_are_recovered(basis: SpectralBasis) -> None:
    """to_coefficients inverts the basis of lights."""
    np.testing.assert_allclose(basis.to_coefficients @ basis.lights.T, np.eye(3), atol=1e-9)


def test_tensor_is_the_integral_of_reflectance_sensitivity_and_light(
    basis: SpectralBasis, camera: Camera
) -> None:
    tensor = basis.tensor(camera.sensitivities)

    assert tensor.shape == (3, 3, 3)
    k, i, j = 2, 0, 1
    product = basis.reflectances[i] * camera.sensitivities[k] * basis.lights[j]
    assert tensor[k, i, j] == pytest.approx(float(product.sum()))


def test_tensor_of_another_camera_differs_in_proportion(
    basis: SpectralBasis, camera: Camera
) -> None:
    twice = basis.tensor(2 * camera.sensitivities)

    np.testing.assert_allclose(twice, 2 * basis.tensor(camera.sensitivities))


@pytest.mark.parametrize(("lamp", "limit_db"), [("A", 28), ("D65", 30), ("FL2", 18)])
def test_lamps_predict_what_the_camera_sees(camera: Camera, lamp: str, limit_db: float) -> None:
    """In the weighted basis a lamp's matrix takes surfaces from flash to lamp, nearly."""
    s, flash = camera.sensitivities, find_light("xenon")
    learnt = learn_basis("wpca", s, reflectance_spectra(), lamp_spectra())
    d = flash_tensor(learnt.tensor(s), learnt.to_coefficients @ flash)
    light = find_light(lamp)
    before = reflectance_spectra() @ (s * flash).T
    after = reflectance_spectra() @ (s * light).T

    predicted = before @ np.einsum("klj,j->kl", d, learnt.to_coefficients @ light).T

    snr = 10 * np.log10(np.square(after).sum() / np.square(predicted - after).sum())
    assert snr > limit_db


@pytest.mark.parametrize("kind", KINDS)
def test_the_scale_of_the_lamps_learnt_from_does_not_matter(kind: str, camera: Camera) -> None:
    scales = np.linspace(0.1, 50, len(lamp_spectra()))[:, None]

    one = learn_basis(kind, camera.sensitivities, reflectance_spectra(), lamp_spectra())
    other = learn_basis(kind, camera.sensitivities, reflectance_spectra(), scales * lamp_spectra())

    np.testing.assert_allclose(other.to_coefficients, one.to_coefficients, rtol=1e-6, atol=1e-9)


def test_plain_pca_is_the_best_basis_of_the_spectra_themselves(camera: Camera) -> None:
    rho = reflectance_spectra()
    learnt = {
        kind: learn_basis(kind, camera.sensitivities, rho, lamp_spectra()).reflectances
        for kind in KINDS
    }

    lost = {
        kind: float(np.linalg.norm(rho - rho @ np.linalg.pinv(b) @ b)) for kind, b in learnt.items()
    }

    assert lost["pca"] < lost["wpca"]
    assert lost["pca"] < lost["joint"]
    assert lost["pca"] == pytest.approx(
        float(np.sqrt(np.square(np.linalg.svd(rho, compute_uv=False)[3:]).sum())), rel=1e-9
    )


def test_weighted_basis_spans_the_leading_weighted_spectra(camera: Camera) -> None:
    rho, s = reflectance_spectra(), camera.sensitivities
    learnt = learn_basis("wpca", s, rho, lamp_spectra()).reflectances

    for channel in s:
        leading = np.linalg.svd(rho * channel, full_matrices=False)[2][0]
        assert np.linalg.norm(learnt @ leading) == pytest.approx(1, abs=1e-9)


def lost(kind: str, s: Floats64, rho: Floats64, lamps: Floats64) -> float:
    """Share of the responses M[k, m, n] that no coefficients of surfaces and lamps explain."""
    lamps = lamps / lamps.sum(axis=1, keepdims=True)
    measured = np.einsum("mw,kw,nw->kmn", rho, s, lamps)
    learnt = learn_basis(kind, s, rho, lamps)
    tensor = learnt.tensor(s)
    b = lamps @ learnt.to_coefficients.T
    for _ in range(100):
        design = np.einsum("kij,nj->kni", tensor, b).reshape(-1, 3)
        target = measured.transpose(0, 2, 1).reshape(-1, len(rho))
        a = np.linalg.lstsq(design, target, rcond=None)[0].T
        design = np.einsum("kij,mi->kmj", tensor, a).reshape(-1, 3)
        b = np.linalg.lstsq(design, measured.reshape(-1, len(lamps)), rcond=None)[0].T
    error = np.einsum("mi,kij,nj->kmn", a, tensor, b) - measured
    return float(np.linalg.norm(error) / np.linalg.norm(measured))


def test_the_joint_basis_preserves_intensities_best(camera: Camera) -> None:
    """Of all measured surfaces under all measured lamps, as the camera sees them."""
    found = {
        kind: lost(kind, camera.sensitivities, reflectance_spectra(), lamp_spectra())
        for kind in KINDS
    }

    assert found["joint"] == pytest.approx(0.0336, abs=2e-4)
    assert found["wpca"] == pytest.approx(0.0345, abs=2e-4)
    assert found["pca"] == pytest.approx(0.0404, abs=2e-4)


@pytest.mark.parametrize("seed", range(4))
def test_the_joint_basis_preserves_intensities_best_of_whatever_is_learnt_from(
    camera: Camera, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    rho = reflectance_spectra()[rng.choice(len(reflectance_spectra()), 40, replace=False)]
    lamps = lamp_spectra()[rng.choice(len(lamp_spectra()), 20, replace=False)]

    found = {kind: lost(kind, camera.sensitivities, rho, lamps) for kind in KINDS}

    assert found["joint"] < 0.99 * found["wpca"]
    assert found["joint"] < 0.99 * found["pca"]


def test_intensities_of_rank_three_are_preserved_exactly_by_the_joint_basis(
    camera: Camera,
) -> None:
    """However much more there is of what the camera does not see."""
    rng = np.random.default_rng(1)
    s = camera.sensitivities
    smooth = np.cumsum(rng.normal(size=(6, s.shape[1])), axis=1)
    seen = 3.0 + smooth / np.abs(smooth).max(axis=1, keepdims=True)
    unseen = np.linalg.svd((s[:, None] * seen[None]).reshape(-1, s.shape[1]))[2][-2:]
    rho = rng.uniform(0.1, 1, (30, 3)) @ seen[:3] + 99 * rng.normal(size=(30, 2)) @ unseen
    lamps = rng.uniform(0.1, 1, (20, 3)) @ seen[3:]

    assert lost("joint", s, rho, lamps) < 1e-7


def test_published_coordinates_are_those_of_orthonormal_lights(basis: SpectralBasis) -> None:
    """The same light from either coordinates, and from the second by an orthonormal basis."""
    orthonormal = np.linalg.inv(basis.published.T) @ basis.lights
    b = np.array([0.4, 0.8, 0.3])

    np.testing.assert_allclose(orthonormal @ orthonormal.T, np.eye(3), atol=1e-9)
    np.testing.assert_allclose((basis.published @ b) @ orthonormal, b @ basis.lights, rtol=1e-7)


def test_an_unknown_kind_is_refused(camera: Camera) -> None:
    with pytest.raises(KeyError, match="nmf"):
        learn_basis("nmf", camera.sensitivities, reflectance_spectra(), lamp_spectra())


@pytest.mark.parametrize("kind", KINDS)
def test_a_camera_of_one_colour_has_no_basis(kind: str, camera: Camera) -> None:
    grey = np.tile(camera.sensitivities[1], (3, 1))

    with pytest.raises(np.linalg.LinAlgError):
        learn_basis(kind, grey, reflectance_spectra(), lamp_spectra())

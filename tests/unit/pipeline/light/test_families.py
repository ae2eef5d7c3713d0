from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.light.families import FamilyBank, learn_families
from pipeline.light.model import Model, build_model
from pipeline.spectra.cameras import Camera
from pipeline.spectra.families import FAMILIES
from pipeline.spectra.lights import find_light, reflectance_spectra


@pytest.fixture(scope="session")
def matrix_of(camera: Camera) -> Callable[[Floats64], Floats64]:
    """Regress the matrix of a lamp on measured reflectances, each of equal brightness."""

    def of_spectrum(light: Floats64) -> Floats64:
        s, rho = camera.sensitivities, reflectance_spectra()
        before, after = rho @ (s * find_light("xenon")).T, rho @ (s * light).T
        scale = before.sum(axis=1, keepdims=True)
        return np.asarray(np.linalg.lstsq(before / scale, after / scale, rcond=None)[0].T)

    return of_spectrum


def as_fitted(matrix: Floats64, model: Model) -> Floats64:
    """Half of what lies outside the model's space, as the fit's narrow prior leaves it."""
    theta = model.prior.coordinates(matrix[None])
    theta[:, 3:] /= 2
    return np.asarray(model.prior.matrices(theta)[0])


@pytest.mark.parametrize(
    ("light", "family", "low", "high"),
    [
        ("H38HT-100 (Mercury)", "mercury or metal halide", 0.95, 1.0),
        ("HPS", "sodium", 0.9, 1.0),
        ("A", "incandescent", 0.4, 0.6),
        ("LED-B1", "white LED", 0.4, 0.7),
        ("D100", "daylight", 0.5, 0.8),
    ],
)
def test_lamps_are_named(
    model: Model,
    matrix_of: Callable[[Floats64], Floats64],
    light: str,
    family: str,
    low: float,
    high: float,
) -> None:
    found, confidence = model.families.nearest(as_fitted(matrix_of(find_light(light)), model))

    assert found == family
    assert low < confidence <= high


def test_probabilities_are_of_all_families(
    model: Model, matrix_of: Callable[[Floats64], Floats64]
) -> None:
    matrix = matrix_of(find_light("FL2"))

    found = model.families.probabilities(matrix)

    assert list(found) == list(FAMILIES)
    assert sum(found.values()) == pytest.approx(1)
    assert model.families.nearest(matrix) == max(found.items(), key=lambda item: item[1])
    for scaled in (5 * matrix, -0.1 * matrix):
        assert model.families.probabilities(scaled) == pytest.approx(found)


def test_far_from_all_measured_lamps_nothing_overflows(model: Model) -> None:
    found = model.families.probabilities(np.diag([0.0, 0.0, 1.0]))
    assert sum(found.values()) == pytest.approx(1)
    assert np.isfinite(list(found.values())).all()


def test_with_another_cameras_sensitivities_less_is_certain(camera: Camera) -> None:
    mercury = [
        build_model(one, find_light("xenon"), find_light("D65"), "wpca").families
        for one in (camera, replace(camera, source="approximate"))
    ]
    matrix = mercury[0].flash_white[None] * np.array([[0.2], [1.0], [0.7]])
    sure, unsure = (families.nearest(matrix)[1] for families in mercury)
    assert [families.spread for families in mercury] == [0.05, 0.2]
    assert unsure < sure


def test_a_bank_weighs_kernels_and_how_often_families_are_met(model: Model) -> None:
    """Two families with one known lamp each, equally near: what is left is how often they are."""
    theta = np.eye(9)[:1]
    one = model.prior.matrices(theta)
    others: dict[str, Any] = dict.fromkeys(FAMILIES, -one)
    away = model.lamp_matrix(np.array([[0.0, 0.1, 1.0]]))
    far = dict.fromkeys(FAMILIES, away) | {"sodium": others["sodium"], "daylight": one}

    bank = learn_families(model.prior, far, model.flash_white, approximate=False)

    assert isinstance(bank, FamilyBank)
    found = bank.probabilities(one[0])
    assert found["daylight"] == pytest.approx(0.15 / 0.18)
    assert found["sodium"] == pytest.approx(0.03 / 0.18)


def test_density_is_the_mean_of_normal_kernels(model: Model) -> None:
    prior, white = model.prior, model.flash_white
    near = model.lamp_matrix(np.array([[0.6, 0.6, 0.5]]))
    far = model.lamp_matrix(np.array([[0.0, 0.1, 1.0]]))
    known = dict.fromkeys(FAMILIES, far)
    known |= {"sodium": near, "xenon": np.concatenate([near, far])}

    found = learn_families(prior, known, white, approximate=False).probabilities(near[0])

    # as often met, but only half of the known lamps of the one are near
    assert found["sodium"] / found["xenon"] == pytest.approx(2)


def test_what_lies_outside_the_models_space_counts_by_half(model: Model) -> None:
    """The fit finds a known lamp with half of its coordinates outside."""
    theta = np.zeros((1, 9))
    theta[0, 0], theta[0, 3] = 0.8, 0.6
    bank = learn_families(
        model.prior,
        {family: model.prior.matrices(theta) for family in FAMILIES},
        model.flash_white,
        approximate=False,
    )
    (place,) = bank.places["sodium"]
    white = model.prior.matrices(theta)[0] @ model.flash_white
    sign = np.sign(white.sum())
    np.testing.assert_allclose(place[:3], sign * white / np.linalg.norm(white))
    np.testing.assert_allclose(place[3:], [sign * 0.3, 0, 0, 0, 0, 0], atol=1e-12)

from __future__ import annotations

import numpy as np
import pytest

from tests.evaluation.baselines.hsu2008 import (
    material_colours,
    mixture_balance,
    unambiguous_mixtures,
)
from tests.evaluation.baselines.matting_laplacian import matting_laplacian
from tests.evaluation.scoring import balance_score

LIGHTS = np.array([[1.5, 1.0, 0.4], [0.6, 1.0, 1.3]])
RATIOS = LIGHTS[:, [0, 2]]
NEUTRAL = np.array([0.7, 1.0, 0.8])
MATERIALS = np.array([[0.5, 0.5, 0.5], [0.2, 0.5, 0.3], [0.5, 0.3, 0.5]])


def scene() -> tuple[np.ndarray, np.ndarray]:
    """Surfaces side by side, the share of the first light rising to the right."""
    which = np.repeat(np.arange(3), 12)[:, None].repeat(60, axis=1)
    share = np.linspace(0.0, 1.0, 60)[None, :, None]
    light = share * LIGHTS[0] + (1 - share) * LIGHTS[1]
    return MATERIALS[which] * light, MATERIALS[which] * NEUTRAL


def logs(colours: np.ndarray) -> np.ndarray:
    colours = colours.reshape(-1, 3)
    return np.asarray(np.log(colours[:, [0, 2]] / colours[:, 1:2]))


def test_materials_are_voted_for() -> None:
    photograph, _ = scene()

    found = material_colours(logs(photograph), RATIOS)

    for material in logs(MATERIALS):
        assert np.abs(found[:3] - material).max(axis=1).min() < 0.05


def test_the_mixture_is_that_of_the_only_material_that_explains_a_pixel() -> None:
    seen = logs(MATERIALS[1] * (0.3 * LIGHTS[0] + 0.7 * LIGHTS[1]))

    known, share = unambiguous_mixtures(seen, logs(MATERIALS), RATIOS)
    twice, _ = unambiguous_mixtures(seen, logs(MATERIALS[[1, 1]]), RATIOS)
    never, _ = unambiguous_mixtures(seen, logs(MATERIALS[[0]]), RATIOS)

    assert known[0]
    assert share[0] == pytest.approx(0.3, abs=0.01)
    assert not twice[0]
    assert not never[0]


def test_two_lights_are_taken_out() -> None:
    photograph, truth = scene()

    found = mixture_balance(photograph.astype(np.float32), LIGHTS, NEUTRAL)

    snr, degrees = balance_score(truth, found, np.ones(truth.shape[:2], bool))
    assert degrees < 2
    assert snr > 25
    np.testing.assert_allclose(found[..., 1], photograph[..., 1], rtol=1e-5)


@pytest.mark.parametrize("scale", [0.01, 100.0])
def test_the_strength_of_lights_and_exposure_do_not_matter(scale: float) -> None:
    photograph, _ = scene()

    plain = mixture_balance(photograph.astype(np.float32), LIGHTS, NEUTRAL)
    scaled = mixture_balance((scale * photograph).astype(np.float32), 3 * LIGHTS, 2 * NEUTRAL)

    np.testing.assert_allclose(scaled, scale * plain, rtol=1e-3)


def test_a_black_photograph_stays_black() -> None:
    found = mixture_balance(np.zeros((8, 9, 3), np.float32), LIGHTS, NEUTRAL)

    assert (found == 0).all()


def test_what_is_affine_in_the_colours_costs_nothing() -> None:
    picture = np.random.default_rng(1).random((7, 9, 2))

    laplacian = matting_laplacian(picture, 1e-9).toarray()

    np.testing.assert_allclose(laplacian, laplacian.T, atol=1e-12)
    np.testing.assert_allclose(laplacian @ np.ones(63), 0, atol=1e-9)
    affine = (2 * picture[..., 0] - picture[..., 1] + 0.3).ravel()
    assert abs(affine @ laplacian @ affine) < 1e-6
    other = np.random.default_rng(2).random(63)
    assert other @ laplacian @ other > 1
    assert np.linalg.eigvalsh(laplacian).min() > -1e-9


def test_values_are_those_of_the_equation() -> None:
    """One window of 3 × 3, by hand: δ − (1 + d_i d_j / (σ² + ε/9)) / 9."""
    picture = np.arange(9.0).reshape(3, 3, 1)
    off = np.arange(9.0) - 4

    found = matting_laplacian(picture, 0.9).toarray()

    expected = np.eye(9) - (1 + np.outer(off, off) / (60 / 9 + 0.1)) / 9
    np.testing.assert_allclose(found, expected)

from __future__ import annotations

import numpy as np
import pytest

from pipeline.errors import UnusablePairError
from pipeline.vectors import unit
from tests.evaluation.baselines import equal_split, nnmf, von_kries_matrices
from tests.evaluation.scoring import joint_snr


def test_equal_split_of_known_lamps_has_the_snr_of_the_formula() -> None:
    photograph = np.random.default_rng(1).random((6, 8, 3)).astype(np.float32)
    truth = np.stack([0.75 * photograph, 0.25 * photograph]).astype(np.float32)

    layers = equal_split(photograph, 2)

    # (.75² + .25²) / (2 · .25²) = 5, whatever the photograph
    snr, _ = joint_snr(truth, layers, np.ones((6, 8), np.bool_))
    assert snr == pytest.approx(10 * np.log10(5), abs=1e-4)
    np.testing.assert_allclose(layers.sum(axis=0), photograph, rtol=1e-6)


def test_nnmf_finds_two_lights_that_never_mix() -> None:
    colours = np.array([[1.0, 0.2, 0.0], [0.0, 0.3, 1.0]])
    strength = np.random.default_rng(2).uniform(0.2, 1.0, (8, 10))
    left = np.arange(10) < 5
    truth = np.stack(
        [
            (strength * side)[..., None] * colour
            for side, colour in zip((left, ~left), colours, strict=True)
        ]
    ).astype(np.float32)

    layers = nnmf(truth.sum(axis=0), 2)

    assert joint_snr(truth, layers, np.ones((8, 10), np.bool_))[0] > 30
    assert (layers >= 0).all()
    np.testing.assert_array_equal(layers, nnmf(truth.sum(axis=0), 2))


def test_nnmf_of_a_black_photograph_is_black() -> None:
    assert not nnmf(np.zeros((4, 4, 3), np.float32), 3).any()


def test_von_kries_finds_lamps_that_are_factors_per_channel() -> None:
    random = np.random.default_rng(3)
    lamps = unit(np.array([[1.0, 0.8, 0.5], [0.6, 0.8, 1.1]]))
    flash = random.uniform(0.05, 1.0, (4000, 3))
    share = np.concatenate([np.zeros(500), random.random(3000), np.ones(500)])
    light = flash * (share[:, None] * lamps[0] + (1 - share[:, None]) * lamps[1])

    found = von_kries_matrices(light, flash, 2)

    assert all(np.count_nonzero(matrix - np.diag(np.diag(matrix))) == 0 for matrix in found)
    cosines = unit(np.diagonal(found, axis1=1, axis2=2)) @ lamps.T
    assert np.degrees(np.arccos(cosines.max(axis=0).clip(max=1.0))).max() < 0.5


def test_von_kries_needs_light() -> None:
    with pytest.raises(UnusablePairError):
        von_kries_matrices(np.ones((50, 3)), np.zeros((50, 3)), 2)

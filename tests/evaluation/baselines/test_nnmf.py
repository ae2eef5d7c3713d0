from __future__ import annotations

import numpy as np

from tests.evaluation.baselines.nnmf import nnmf
from tests.evaluation.scoring import joint_snr


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

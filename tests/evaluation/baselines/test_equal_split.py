from __future__ import annotations

import numpy as np
import pytest

from tests.evaluation.baselines.equal_split import equal_split
from tests.evaluation.scoring import joint_snr


def test_equal_split_of_known_lamps_has_the_snr_of_the_formula() -> None:
    photograph = np.random.default_rng(1).random((6, 8, 3)).astype(np.float32)
    truth = np.stack([0.75 * photograph, 0.25 * photograph]).astype(np.float32)

    layers = equal_split(photograph, 2)

    # (.75² + .25²) / (2 · .25²) = 5, whatever the photograph
    snr, _ = joint_snr(truth, layers, np.ones((6, 8), np.bool_))
    assert snr == pytest.approx(10 * np.log10(5), abs=1e-4)
    np.testing.assert_allclose(layers.sum(axis=0), photograph, rtol=1e-6)

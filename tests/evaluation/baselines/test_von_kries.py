from __future__ import annotations

import numpy as np
import pytest

from pipeline.errors import UnusablePairError
from pipeline.vectors import unit
from tests.evaluation.baselines.von_kries import von_kries_matrices


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

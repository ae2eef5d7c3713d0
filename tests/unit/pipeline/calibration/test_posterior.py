from __future__ import annotations

import numpy as np
import pytest

from pipeline.calibration.posterior import best_scale, posterior, smooth, weights
from pipeline.spectra.wavelengths import WAVELENGTHS_NM

_WIDTH = len(WAVELENGTHS_NM)


def test_deviations_correlate_by_their_distance() -> None:
    correlation = smooth(60.0)
    assert np.diag(correlation) == pytest.approx(1.0)
    # 60 nm are 12 steps
    assert correlation[0, 12] == pytest.approx(np.exp(-0.5))
    assert correlation[3, 40] == correlation[40, 3]


def test_one_number_moves_one_gaussian_as_bayes_says() -> None:
    matrix = np.zeros((1, _WIDTH))
    matrix[0, 7] = 2.0
    mean, covariance = np.full(_WIDTH, 1.0), 3.0 * np.eye(_WIDTH)
    found, evidence = posterior(matrix, np.array([4.0]), np.array([1.0]), mean, covariance)
    # gain 3·2/(2·3·2 + 1) = 6/13, surprise 4 − 2 = 2
    assert found[7] == pytest.approx(1 + 12 / 13)
    assert np.delete(found, 7) == pytest.approx(1.0)
    assert evidence == pytest.approx(-0.5 * (4 / 13 + np.log(13)))


def test_without_noise_what_was_seen_is_kept() -> None:
    random = np.random.default_rng(1)
    matrix, truth = random.uniform(size=(5, _WIDTH)), random.uniform(size=_WIDTH)
    tiny = np.full(5, 1e-10)
    found, _ = posterior(matrix, matrix @ truth, tiny, np.zeros(_WIDTH), smooth(40.0))
    assert matrix @ found == pytest.approx(matrix @ truth, rel=1e-5)


def test_the_scale_is_the_weighted_one_and_never_negative() -> None:
    predicted, seen = np.array([1.0, 2.0]), np.array([3.0, 4.0])
    assert best_scale(predicted, seen, np.array([1.0, 1e12])) == pytest.approx(3.0)
    assert best_scale(predicted, seen, np.ones(2)) == pytest.approx(11 / 5)
    assert 0 < best_scale(predicted, -seen, np.ones(2)) < 1e-9


def test_evidence_becomes_probabilities_at_any_height() -> None:
    assert weights([-1e6, -1e6 + np.log(3)]) == pytest.approx([0.25, 0.75])

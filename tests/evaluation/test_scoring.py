from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.arrays import Floats32
from tests.evaluation.scoring import (
    balance_score,
    coefficient_error_deg,
    joint_snr,
    valid_pixels,
)

EVERYWHERE = np.ones((2, 4), dtype=np.bool_)


def truth() -> Floats32:
    """Two lamps of light 1 and 2 everywhere, 2 × 4 pixels."""
    return np.stack([np.full((2, 4, 3), value, np.float32) for value in (1.0, 2.0)])


def test_snr_is_that_of_all_layers_together() -> None:
    layers = truth() + np.array([0.1, 0.2], np.float32)[:, None, None, None]

    snr, order = joint_snr(truth(), layers, EVERYWHERE)

    assert snr == pytest.approx(10 * np.log10((1 + 4) / (0.01 + 0.04)), abs=1e-4)  # 20 dB
    assert order == (0, 1)


def test_layers_may_come_in_any_order() -> None:
    lamps = np.concatenate([truth(), np.full((1, 2, 4, 3), 5.0, np.float32)])
    layers = lamps[[2, 0, 1]] + np.float32(0.1)

    snr, order = joint_snr(lamps, layers, EVERYWHERE)

    assert order == (1, 2, 0)
    assert snr == pytest.approx(10 * np.log10(30 / 0.03), abs=1e-3)


def test_no_layer_is_rescaled() -> None:
    snr, _ = joint_snr(truth(), truth() / 2, EVERYWHERE)

    assert snr == pytest.approx(10 * np.log10(4), abs=1e-5)


def test_nothing_at_all_is_0_db() -> None:
    assert joint_snr(truth(), np.zeros_like(truth()), EVERYWHERE)[0] == pytest.approx(0.0)


def test_exact_layers_are_infinitely_good() -> None:
    assert joint_snr(truth(), truth(), EVERYWHERE)[0] == np.inf


def test_other_pixels_do_not_count() -> None:
    layers = truth() * np.float32(0.9)
    layers[:, 0, 0] = 100.0
    valid = EVERYWHERE.copy()
    valid[0, 0] = False

    assert joint_snr(truth(), layers, valid)[0] == pytest.approx(20.0, abs=1e-4)
    assert joint_snr(truth(), layers, EVERYWHERE)[0] < 0


def test_another_number_of_layers_is_refused() -> None:
    with pytest.raises(ValueError, match="where the truth is"):
        joint_snr(truth(), truth()[:1], EVERYWHERE)


def test_layers_without_a_value_are_refused() -> None:
    layers = truth()
    layers[1, 0, 0, 2] = np.nan

    with pytest.raises(ValueError, match="not finite"):
        joint_snr(truth(), layers, EVERYWHERE)


def test_pixels_count_where_the_flash_arrives_and_nothing_is_clipped() -> None:
    lamps = np.full((2, 10, 20, 3), 0.1, np.float32)
    flash = np.full((10, 20, 3), 0.5, np.float32)
    flash[0, 0] = 0.004  # of .5: below 1 %
    flash[0, 1] = 0.006
    lamps[0, 1, 0, 2] = 0.45  # with the other lamp and the flash 1.05
    lamps[0, 1, 1, 2] = 0.35

    valid = valid_pixels(lamps, flash, 1.0)

    assert not valid[0, 0]
    assert not valid[1, 0]
    assert valid.sum() == 198
    assert valid_pixels(lamps, flash, 1.1)[1, 0]


def test_coefficient_error_is_the_mean_angle_in_the_order_found() -> None:
    lamps = np.array([[1.0, 0.0, 0.0], [0.0, 2.0, 0.0]])
    found = np.array([[0.0, 1.0, 1.0], [3.0, 0.0, 0.0]])

    assert coefficient_error_deg(lamps, found, (1, 0)) == pytest.approx(22.5)
    assert coefficient_error_deg(lamps, found, (0, 1)) == pytest.approx(90.0)


def test_coefficient_error_is_exact_for_small_angles() -> None:
    lamps, found = np.array([[1.0, 0.0, 0.0]]), np.array([[1.0, 1e-9, 0.0]])

    assert coefficient_error_deg(lamps, found, (0,)) == pytest.approx(np.degrees(1e-9))


def pictures() -> tuple[Floats32, NDArray[np.bool_]]:
    truth = np.random.default_rng(3).uniform(0.1, 1, (8, 10, 3)).astype(np.float32)
    return truth, np.ones((8, 10), np.bool_)


def test_one_scale_for_all_costs_nothing() -> None:
    truth, valid = pictures()

    snr, degrees = balance_score(truth, 3 * truth, valid)

    assert snr > 100
    assert degrees < 1e-4


def test_the_scale_is_that_which_fits_best() -> None:
    """Of (1, 0) and (0, 1) against (1, 1) each, half of the power is left: 10·log10 2."""
    truth = np.ones((1, 2, 3), np.float32)
    found = truth * np.array([1, 0], np.float32)[:, None]

    snr, degrees = balance_score(truth, found, np.ones((1, 2), np.bool_))

    assert snr == pytest.approx(10 * np.log10(2))
    assert degrees == pytest.approx(45)  # of 0° and of 90°, where there is no light at all


def test_only_valid_pixels_count() -> None:
    truth, valid = pictures()
    found = truth.copy()
    found[2:4] = 7
    valid[2:4] = False

    assert balance_score(truth, found, valid)[0] > 100


def test_values_must_be_finite() -> None:
    truth, valid = pictures()
    found = truth.copy()
    found[0, 0, 0] = np.nan

    with pytest.raises(ValueError, match="not finite"):
        balance_score(truth, found, valid)

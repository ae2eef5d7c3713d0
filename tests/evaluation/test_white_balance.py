from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.spectra.lights import find_light
from tests.evaluation.conditions import Condition, make_shot
from tests.evaluation.results import Result, run_scene
from tests.evaluation.scenes import NEUTRAL, render_neutral, render_scene, scenes
from tests.evaluation.spectra import sensitivities
from tests.evaluation.white_balance import BALANCES, score

SMALL = Condition(size=(128, 96))


@cache
def results() -> dict[str, Result]:
    scene = scenes("two", "development")[2]
    return {r.method: r for r in run_scene(scene, SMALL, tuple(BALANCES))}


def pictures() -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    truth = np.random.default_rng(3).uniform(0.1, 1, (8, 10, 3)).astype(np.float32)
    return truth, np.ones((8, 10), np.bool_)


def test_one_scale_for_all_costs_nothing() -> None:
    truth, valid = pictures()

    snr, degrees = score(truth, 3 * truth, valid)

    assert snr > 100
    assert degrees < 1e-4


def test_the_scale_is_that_which_fits_best() -> None:
    """Of (1, 0) and (0, 1) against (1, 1) each, half of the power is left: 10·log10 2."""
    truth = np.ones((1, 2, 3), np.float32)
    found = truth * np.array([1, 0], np.float32)[:, None]

    snr, degrees = score(truth, found, np.ones((1, 2), np.bool_))

    assert snr == pytest.approx(10 * np.log10(2))
    assert degrees == pytest.approx(45)  # of 0° and of 90°, where there is no light at all


def test_only_valid_pixels_count() -> None:
    truth, valid = pictures()
    found = truth.copy()
    found[2:4] = 7
    valid[2:4] = False

    assert score(truth, found, valid)[0] > 100


def test_values_must_be_finite() -> None:
    truth, valid = pictures()
    found = truth.copy()
    found[0, 0, 0] = np.nan

    with pytest.raises(ValueError, match="not finite"):
        score(truth, found, valid)


def test_a_scene_under_the_neutral_light_keeps_its_green() -> None:
    scene = scenes("two", "development")[2]

    neutral = render_neutral(scene, SMALL.size)

    photograph = render_scene(scene, SMALL.size).no_flash_frame
    lit = photograph[..., 1] > 0
    assert np.median(neutral[lit, 1] / photograph[lit, 1]) == pytest.approx(1, abs=0.05)
    # under white light of two kinds, surfaces look nearly alike
    shot, s = make_shot(scene, SMALL), sensitivities(scene.camera)
    by_flash = (shot.flash_part / (s @ shot.flash_spectrum)).astype(np.float32)
    by_neutral = (neutral / (s @ find_light(NEUTRAL))).astype(np.float32)
    assert score(by_flash, by_neutral, shot.valid)[1] < 3


def test_ours_shows_the_colours_of_the_scene() -> None:
    found = results()
    errors = {method: result.error_deg for method, result in found.items()}
    assert all(error is not None for error in errors.values())

    assert (errors["best_1"] or 0) < 0.35
    assert (found["best_1"].snr_db or 0) > 30
    assert (errors["paper_1"] or 0) > 2 * (errors["best_1"] or 0)
    assert (errors["grey_world"] or 0) > 2
    assert (errors["uncorrected"] or 0) > (errors["hui_2016"] or 0)

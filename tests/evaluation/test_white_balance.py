from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from pipeline.spectra.lights import find_light
from tests.evaluation.conditions import Condition, make_shot
from tests.evaluation.results import Result, run_scene
from tests.evaluation.scenes import NEUTRAL, render_neutral, render_scene, scenes
from tests.evaluation.scoring import balance_score
from tests.evaluation.spectra import sensitivities
from tests.evaluation.white_balance import BALANCES

SMALL = Condition(size=(128, 96))


@cache
def results() -> dict[str, Result]:
    scene = scenes("two", "development")[2]
    return {r.method: r for r in run_scene(scene, SMALL, tuple(BALANCES))}


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
    assert balance_score(by_flash, by_neutral, shot.valid)[1] < 3


def test_ours_shows_the_colours_of_the_scene() -> None:
    found = results()
    errors = {method: result.error_deg for method, result in found.items()}
    assert all(error is not None for error in errors.values())

    assert (errors["best_1"] or 0) < 0.35
    assert (found["best_1"].snr_db or 0) > 30
    assert (errors["paper_1"] or 0) > 2 * (errors["best_1"] or 0)
    assert (errors["grey_world"] or 0) > 2
    assert (errors["uncorrected"] or 0) > (errors["hui_2016"] or 0)

"""The evaluation in small: four scenes of 128 × 96."""

from __future__ import annotations

from functools import cache

import pytest

from pipeline.lamps import lamps
from pipeline.matrixfit.deviations import no_deviations
from tests.evaluation import methods
from tests.evaluation.conditions import Condition, make_shot
from tests.evaluation.results import Result, run_scene
from tests.evaluation.scenes import scenes
from tests.evaluation.scoring import joint_snr

SMALL = (128, 96)
METHODS = ("equal", "paper", "best", "best_3x3", "tuned_3x3")


@cache
def results(group: str, number: int) -> dict[str, Result]:
    scene = scenes(group, "development")[number]
    return {r.method: r for r in run_scene(scene, Condition(size=SMALL), METHODS)}


def snr(group: str, number: int, method: str) -> float:
    value = results(group, number)[method].snr_db
    assert value is not None
    return value


@pytest.mark.parametrize(("group", "number", "least"), [("two", 2, 22.0), ("three", 1, 6.0)])
def test_lamps_are_separated(group: str, number: int, least: float) -> None:
    assert snr(group, number, "best") > least
    assert snr(group, number, "best") > snr(group, number, "paper") - 0.5
    assert snr(group, number, "best") > snr(group, number, "equal") + 1


@pytest.mark.parametrize(("group", "number"), [("two", 2), ("three", 1)])
def test_the_ceilings_are_above_the_published_method(group: str, number: int) -> None:
    assert snr(group, number, "best_3x3") > snr(group, number, "paper") + 3
    assert snr(group, number, "tuned_3x3") > snr(group, number, "best_3x3") - 0.2


@pytest.mark.parametrize(("group", "number"), [("two", 4), ("three", 20)])
def test_what_surfaces_of_unlike_colours_tell_is_gained(
    group: str, number: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    shot = make_shot(scenes(group, "development")[number], Condition(size=SMALL))

    def found() -> float:
        return joint_snr(shot.truth, methods.METHODS["best"](shot).layers, shot.valid)[0]

    with_them = found()
    monkeypatch.setattr(lamps, "find_deviations", lambda *_: no_deviations(shot.count))
    assert with_them > found() + 0.4  # .9 and .8 dB; lamps mixed up lose


def test_coefficients_of_the_lamps_are_found() -> None:
    error = results("two", 2)["best"].error_deg
    assert error is not None
    assert error < 1  # .34°


@pytest.mark.parametrize(("group", "count"), [("one", 1), ("two", 2)])
def test_lamps_are_counted(group: str, count: int) -> None:
    scene = scenes(group, "development")[2]

    (best,) = run_scene(scene, Condition(size=SMALL, lights="auto"), ("best",))

    assert best.found == count
    assert best.confidence is not None
    assert best.confidence > 0.5

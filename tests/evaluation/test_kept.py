from __future__ import annotations

import json
from pathlib import Path

from tests.evaluation.figures import Outcome
from tests.evaluation.kept import with_kept
from tests.evaluation.results import Result
from tests.evaluation.scenes import CAMERA, scenes

EVERY = scenes("cameras-two", "report")


def _measured(scene: str, snr_db: float) -> Result:
    return Result(
        scene=scene,
        method="best",
        snr_db=snr_db,
        error_deg=None,
        lamps=2,
        found=2,
        confidence=None,
        warnings=(),
        refusal="",
        cpu_s=1.0,
    )


def test_cameras_that_are_not_at_hand_keep_what_is_written_of_them(tmp_path: Path) -> None:
    own = next(scene for scene in EVERY if scene.camera == CAMERA)
    foreign = next(scene for scene in EVERY if scene.camera != CAMERA)
    absent = next(scene for scene in EVERY if scene.camera not in (CAMERA, foreign.camera))
    written = {scene.name: {"snr_db": {"best": 11.0}} for scene in (own, foreign, absent)}
    report = tmp_path / "evaluation.json"
    report.write_text(json.dumps({"experiments": {"cameras-two": {"results": written}}}))
    outcome = Outcome(
        {"cameras-two": [_measured(own.name, 20.0), _measured(foreign.name, 21.0)]},
        {own.name: own, foreign.name: foreign},
    )

    found = with_kept(outcome, report)

    decibels = {result.scene: result.snr_db for result in found.results["cameras-two"]}
    assert decibels == {own.name: 20.0, foreign.name: 21.0, absent.name: 11.0}
    assert found.scenes[absent.name].camera == absent.camera


def test_without_a_report_there_is_nothing_to_keep(tmp_path: Path) -> None:
    outcome = Outcome({"cameras-two": [_measured(EVERY[0].name, 20.0)]}, {EVERY[0].name: EVERY[0]})
    assert with_kept(outcome, tmp_path / "evaluation.json") is outcome

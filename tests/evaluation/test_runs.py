from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path

import pytest

from tests.evaluation import runs
from tests.evaluation.conditions import Condition
from tests.evaluation.experiments import EXPERIMENTS, Experiment
from tests.evaluation.runs import run
from tests.evaluation.scenes import scenes
from tests.evaluation.spectra import at_hand, sensitivities


def test_runs_know_no_spectra_of_ones_own(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("LIGHTLAYERS_SPECTRA", str(tmp_path))

    outcome = run((), (), "development", lambda *_: None)

    assert "LIGHTLAYERS_SPECTRA" not in os.environ
    assert outcome.results == {}


def test_workers_are_handed_the_cameras_that_are_at_hand(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    first, other, absent = "Nikon D5100", "Test One", "Test Two"
    rows = {nm: [nm / 780, 1.0, 1 - nm / 780] for nm in range(380, 781, 5)}
    table = {"spectral_data": {"data": {"main": rows}}}
    (tmp_path / "Test_One_380_780_5.json").write_text(json.dumps(table))
    monkeypatch.setenv("LIGHTLAYERS_SPECTRA", str(tmp_path))
    room = scenes("one", "development")[0]
    taken = [replace(room, name=f"{room.name}, {c}", camera=c) for c in (first, other, absent)]
    monkeypatch.setattr(runs, "scenes", lambda *_: taken)
    small = Experiment("one", ("equal",), Condition(size=(32, 24)))
    monkeypatch.setitem(EXPERIMENTS, "cameras-two", small)
    assert [at_hand(camera) for camera in (first, other, absent)] == [True, True, False]

    outcome = run(("cameras-two",), ("equal",), "development", lambda *_: None)

    assert "LIGHTLAYERS_SPECTRA" not in os.environ
    assert [r.scene for r in outcome.results["cameras-two"]] == [one.name for one in taken[:2]]
    assert list(outcome.scenes) == [one.name for one in taken[:2]]
    assert sensitivities(other)[0, -1] == 1.0

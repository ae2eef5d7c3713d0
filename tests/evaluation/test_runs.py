from __future__ import annotations

import os
from pathlib import Path

import pytest

from tests.evaluation.runs import run


def test_runs_know_no_spectra_of_ones_own(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("LIGHTLAYERS_SPECTRA", str(tmp_path))

    outcome = run((), (), "development", lambda *_: None)

    assert "LIGHTLAYERS_SPECTRA" not in os.environ
    assert outcome.results == {}

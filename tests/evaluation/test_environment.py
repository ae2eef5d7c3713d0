from __future__ import annotations

import os
from pathlib import Path

import pytest

from tests.evaluation.environment import settle


@pytest.mark.parametrize("own_spectra", [True, False])
def test_workers_know_no_spectra_of_ones_own_unless_asked(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, own_spectra: bool
) -> None:
    monkeypatch.setenv("LIGHTLAYERS_SPECTRA", str(tmp_path))
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "4")

    settle(own_spectra)

    assert os.environ.get("LIGHTLAYERS_SPECTRA") == (str(tmp_path) if own_spectra else None)
    assert os.environ["OPENBLAS_NUM_THREADS"] == "1"

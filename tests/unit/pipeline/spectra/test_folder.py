"""The user's own folder; what is found in it is tested with lights and cameras."""

from __future__ import annotations

from pathlib import Path

import pytest

from pipeline.spectra.folder import names_are_known


@pytest.mark.parametrize(
    ("setting", "known"), [(None, True), ("", True), ("here", True), ("file", False), ("-", False)]
)
def test_names_are_known_but_where_the_folder_is_elsewhere(
    setting: str | None, known: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "here").mkdir()
    (tmp_path / "file").touch()
    monkeypatch.delenv("LIGHTLAYERS_SPECTRA", raising=False)
    if setting is not None:
        monkeypatch.setenv("LIGHTLAYERS_SPECTRA", setting and str(tmp_path / setting))
    assert names_are_known() is known

from __future__ import annotations

from pathlib import Path

import pytest

from pipeline.manifest_parts import write_manifest


def test_the_manifest_is_written_as_text(tmp_path: Path) -> None:
    write_manifest(tmp_path, {"lamps": [], "message": "5° apart"})

    text = (tmp_path / "manifest.json").read_text(encoding="utf-8")
    assert text == '{\n  "lamps": [],\n  "message": "5° apart"\n}\n'


def test_no_manifest_holds_a_figure_that_is_none(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_manifest(tmp_path, {"filled": float("nan")})

    assert list(tmp_path.iterdir()) == []

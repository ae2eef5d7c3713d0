from __future__ import annotations

import json
from pathlib import Path

import pytest

from service import demo


def test_the_demo_shows_files_lamps_and_snr(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "demo"
    mean = demo.run("sim://studio?lights=2&width=450&height=300", folder)
    assert mean >= demo.LEAST_SNR_DB
    said = capsys.readouterr()
    stages = ["capture …", "decode …", "align …", "lamps …", "layers …", "encode …"]
    told = said.err.splitlines()  # a quick stage may pass unseen
    assert len(told) >= 2
    assert told == [stage for stage in stages if stage in told]
    manifest = json.loads((folder / "manifest.json").read_bytes())
    shown = " ".join(said.out.split())
    for file in manifest["files"]:
        assert (folder / file["name"]).stat().st_size > 0
        assert file["name"] in said.out
    for lamp in manifest["lamps"]:
        assert f"{lamp['name']} │" in shown
        assert f"{lamp['cct_k']:.0f} K" in shown
    assert f"{mean:.1f} dB" in shown

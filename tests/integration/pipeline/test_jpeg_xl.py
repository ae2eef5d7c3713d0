"""A pair of DNGs in JPEG XL gives what the same pair gives uncompressed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from drivers import CapturedPair, capture_pair, open_camera
from service.cli import run
from tests.jpeg_xl import in_jpeg_xl

ADDRESS = "sim://studio?lights=2&width=192&height=128"


@pytest.fixture(scope="module")
def pair() -> CapturedPair:
    with open_camera(ADDRESS) as camera:
        return capture_pair(camera)


def separated(folder: Path, no_flash: bytes, flash: bytes) -> tuple[dict[str, bytes], Any]:
    """Files of results by name, and the manifest."""
    folder.mkdir()
    (folder / "no_flash.dng").write_bytes(no_flash)
    (folder / "flash.dng").write_bytes(flash)
    photographs = [str(folder / name) for name in ("no_flash.dng", "flash.dng")]
    out = folder / "out"
    assert run(["separate", *photographs, "-o", str(out), "--quality", "fast"]) == 0
    files = {path.name: path.read_bytes() for path in out.iterdir()}
    return files, json.loads(files.pop("manifest.json"))


def test_layers_are_the_same(
    pair: CapturedPair, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plain = [shot.files["dng"] for shot in (pair.no_flash, pair.flash)]
    files, manifest = separated(tmp_path / "plain", *plain)

    same, told = separated(tmp_path / "jpeg_xl", *map(in_jpeg_xl, plain))

    assert "lamp1.tif" in files
    assert same == files
    assert told["camera"] == manifest["camera"]
    assert told["lamps"] == manifest["lamps"]
    for name, before in manifest["inputs"].items():
        after = told["inputs"][name]
        assert after.pop("sha256") != before.pop("sha256")
        assert after == before
    capsys.readouterr()

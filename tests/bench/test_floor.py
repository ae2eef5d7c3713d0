from __future__ import annotations

import time
from datetime import UTC, datetime
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
import pytest
import simplejpeg

from drivers.sim.files import Shooting, write_dng
from tests.bench import floor as bench
from tests.bench.floor import floor
from tests.bench.usage import Usage


@pytest.fixture
def pair(tmp_path: Path) -> list[Path]:
    """A soft pattern and the same moved by 8 pixels, as JPEGs."""
    noise = np.random.default_rng(1).integers(0, 255, (800, 1008, 3)).astype(np.uint8)
    blurred = cv2.GaussianBlur(noise, (0, 0), 12)
    soft = cv2.normalize(blurred, np.empty_like(blurred), 0, 255, cv2.NORM_MINMAX)
    paths = [tmp_path / "a.jpg", tmp_path / "b.jpg"]
    for path, left in zip(paths, (0, 8), strict=True):
        picture = np.ascontiguousarray(soft[:, left : left + 1000])
        path.write_bytes(simplejpeg.encode_jpeg(picture, 98, "RGB", "444"))
    return paths


def test_codes_are_shares_of_white(tmp_path: Path) -> None:
    grey = np.full((16, 16, 3), 128, np.uint8)
    (tmp_path / "a.jpg").write_bytes(simplejpeg.encode_jpeg(grey, 100, "RGB", "444"))
    light = bench._light(bench._decoded(tmp_path / "a.jpg"))
    assert light == pytest.approx(128 / 255, abs=0.005)


def test_raw_light_outlives_its_file(tmp_path: Path) -> None:
    """Of a size that the system takes back as soon as LibRaw frees it."""
    mosaic = np.full((1600, 2400), 20000, np.uint16)
    taken = datetime(2026, 1, 2, tzinfo=UTC)
    shooting = Shooting(Fraction(1, 60), Fraction(4), 200, False, 35.0, taken)
    (tmp_path / "a.dng").write_bytes(write_dng(mosaic, shooting))
    light = bench._light(bench._decoded(tmp_path / "a.dng"))
    assert light[2:-2, 2:-2] == pytest.approx(20000 / 65535, abs=1e-4)


def test_the_second_picture_is_laid_upon_the_first(pair: list[Path]) -> None:
    first, second = (bench._light(bench._decoded(path)) for path in pair)
    inside = np.s_[40:-40, 40:-40]
    assert np.abs(first - second)[inside].mean() > 0.03
    assert np.abs(first - bench._aligned(first, second))[inside].mean() < 0.01


def test_every_stage_has_its_share(pair: list[Path], monkeypatch: pytest.MonkeyPatch) -> None:
    """A copy counts five times, and imports as what a fresh process takes."""
    ticks = iter([0, 1, 1, 3, 3, 3.5, 10, 14])
    monkeypatch.setattr(time, "process_time", lambda: next(ticks))
    monkeypatch.setattr(bench, "run", lambda _command: Usage(0.6, 0.7, 50))
    found = floor(pair[0], pair[1], lights=2)
    assert found == {"decode": 1, "align": 2, "layers": 2.5, "encode": 4, "imports": 0.6}

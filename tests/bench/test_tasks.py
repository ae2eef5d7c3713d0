from __future__ import annotations

from pathlib import Path

import pytest

import drivers
from tests.bench.tasks import start, two_at_once


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("pair")
    with drivers.open_camera("sim://studio?lights=2&width=96&height=64&format=jpeg") as camera:
        pair = drivers.capture_pair(camera)
    paths = folder / "no_flash", folder / "flash"
    for path, shot in zip(paths, (pair.no_flash, pair.flash), strict=True):
        path.write_bytes(shot.best)
    return paths


def test_every_figure_of_a_start_is_measured(files: tuple[Path, Path]) -> None:
    found = start(files, tasks=3)

    assert set(found) == {
        "first_byte_s",
        "worst_first_byte_s",
        "cpu_s",
        "bare_wall_s",
        "bare_cpu_s",
    }
    assert 0 < found["first_byte_s"] <= found["worst_first_byte_s"]
    assert found["bare_cpu_s"] > 0


def test_two_separations_run_to_their_ends(files: tuple[Path, Path]) -> None:
    found = two_at_once(files, {"lights": 2})

    assert found["speedup"] > 0
    assert found["cpu_ratio"] > 0

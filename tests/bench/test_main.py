from __future__ import annotations

import json
import os
from collections.abc import Sequence
from itertools import count
from pathlib import Path
from typing import Any

import pytest

from tests.bench import __main__ as module
from tests.bench import align, kernel, quality, tasks
from tests.bench.usage import Usage


@pytest.fixture
def measured(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[Sequence[str]]:
    """Measure nothing, with figures that grow from call to call; the jobs that were to be run."""
    jobs: list[Sequence[str]] = []
    rounds = count()
    leanest = {"decode": 1.0, "align": 3.0}

    def run(command: Sequence[str]) -> Usage:
        jobs.append(command)
        megapixels = 12 if "jpeg12" in command[2] else 3
        if "--light-directions" in command:
            told = json.loads(Path(command[-1]).read_text())["lights"]
            assert [len(light["direction"]) for light in told] == [3] * 3
            megapixels = 5
        return Usage(megapixels, 4.0, 300.0 + next(rounds))

    def two_at_once(files: Sequence[Path], options: dict[str, Any]) -> dict[str, float]:
        assert (files[0].parent.name, options) == ("jpeg12_n2", {"lights": 2})
        number = next(rounds)
        return {"speedup": 1.0 + number, "cpu_ratio": 2.0 + number}

    monkeypatch.setattr(module, "run", run)
    monkeypatch.setattr(tasks, "two_at_once", two_at_once)
    monkeypatch.setattr(tasks, "start", lambda files: {"first_byte_s": len(files)})
    monkeypatch.setattr(quality, "measure", lambda cpu: {"fast": cpu("fast")})
    monkeypatch.setattr(module, "pair_files", lambda name: (Path(name, "a"), Path(name, "b")))
    monkeypatch.setattr(module, "floor", lambda *_: leanest | {"layers": next(rounds) % 2})
    monkeypatch.setattr(module, "_stages", lambda _: {"decode": 2.0, "align": 2.0, "lamps": 6.5})
    monkeypatch.setattr(kernel, "measure", lambda: {"memcpy_ratio": 10.0})
    monkeypatch.setattr(align, "measure", lambda pair: {"pair": pair})
    monkeypatch.setattr(module, "report", lambda figures: f"{len(figures)} parts")
    monkeypatch.setattr(module, "draw_profile", lambda jobs, path: path.write_text(" ".join(jobs)))
    monkeypatch.setattr(module, "_DOCS", tmp_path)
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "2")
    (tmp_path / "images").mkdir()
    return jobs


def bench(monkeypatch: pytest.MonkeyPatch, *flags: str) -> None:
    monkeypatch.setattr("sys.argv", ["tests.bench", *flags])
    assert module.main() == 0


def test_the_short_bench_prints_the_kernel_and_one_job(
    measured: list[Sequence[str]],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
) -> None:
    bench(monkeypatch, "--quick")

    figures = json.loads(capsys.readouterr().out)
    assert figures["kernel"] == {"memcpy_ratio": 10.0}
    assert figures["jobs"] == {
        "jpeg12_n2": {
            "cpu_s": 12,
            "wall_s": 4.0,
            "peak_mb": 300.0,
            "floor_ratio": 3.0,  # 12 over 4: the job's own alignment is the leanest that is known
            "stages_cpu_s": {"decode": 2.0, "align": 2.0, "lamps": 6.5},
            "floor_cpu_s": {"decode": 1.0, "align": 2.0, "layers": 1},
        }
    }
    assert figures["start"] == {"first_byte_s": 2}
    assert len(figures) == 3
    assert os.environ["OPENBLAS_NUM_THREADS"] == "1"
    (command,) = measured
    assert command[1:5] == ["separate", "jpeg12_n2/a", "jpeg12_n2/b", "-o"]
    assert command[6:] == ["--lights", "2"]
    assert list((tmp_path / "images").iterdir()) == []


def test_the_whole_bench_writes_a_page_its_figures_and_a_picture(
    measured: list[Sequence[str]], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    bench(monkeypatch)

    figures: dict[str, Any] = json.loads((tmp_path / "performance.json").read_text())
    assert figures["align"] == {"pair": "jpeg12_n2"}
    # of three rounds, between which two jobs are run, too
    assert figures["growth"] == {
        "pixels4_cpu_ratio": 4.0,
        "parallel2_speedup": 24.0,
        "parallel2_cpu_ratio": 25.0,
    }
    assert figures["quality"] == {"fast": 3}
    assert figures["normals"] == {"cpu_s": 5, "without_cpu_s": 3}
    assert measured[-1][2].startswith("raw24_n3") and measured[-1][-2:] == ["--quality", "fast"]
    # of three rounds, between which the floor's is called, too
    assert [job["peak_mb"] for job in figures["jobs"].values()] == [302, 308, 314]
    assert [command[-1] for command in measured[:9]] == ["2"] * 3 + ["3"] * 3 + ["2"] * 3
    assert (tmp_path / "performance.md").read_text() == "7 parts"
    assert (tmp_path / "images/performance.png").read_text() == "jpeg12_n2 raw24_n3 jpeg48_n2"

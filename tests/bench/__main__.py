"""How much a job costs: python -m tests.bench [--quick], as `make bench` and `make bench QUICK=1`.

Everything is measured by turns in one run, because machines differ and are noisy: what counts are
ratios. Without --quick this writes docs/performance.md, its data and its picture.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from pathlib import Path
from statistics import median
from typing import Any

import drivers
from tests.bench import align, kernel, quality, tasks
from tests.bench.floor import floor
from tests.bench.pairs import PAIRS, pair_files
from tests.bench.report import draw_profile, report
from tests.bench.usage import Usage, medians, python, run

_DOCS = Path(__file__).parents[2] / "docs"
_ROUNDS = 3
_JOBS = ("jpeg12_n2", "raw24_n3", "jpeg48_n2")
_SMALL, _LARGE, _FACING = "jpeg3_n2", "jpeg12_n2", "raw12_n3"
_OBJECTS = "sim://studio?lights=3&width=120&height=80&scene=objects"  # as _FACING, but small


def main() -> int:
    """Measure and write; the exit code."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench")
    parser.add_argument(
        "--quick", action="store_true", help="the kernel, one job and a start, printed"
    )
    quick = parser.parse_args().quick
    os.environ["OPENBLAS_NUM_THREADS"] = "1"  # as the command has it
    figures: dict[str, Any] = {"kernel": kernel.measure()}
    jobs = _JOBS[:1] if quick else _JOBS
    rounds = 1 if quick else _ROUNDS
    figures["jobs"] = {name: _job(name, rounds) for name in jobs}
    figures["start"] = tasks.start(pair_files(_LARGE))
    if not quick:
        figures["align"] = align.measure(_LARGE)
        figures["growth"] = _growth()
        figures["normals"] = _normals()
        figures["quality"] = quality.measure(
            lambda asked: _separated("raw24_n3", "--quality", asked).cpu_s
        )
        (_DOCS / "performance.json").write_text(json.dumps(figures, indent=1) + "\n")
        (_DOCS / "performance.md").write_text(report(figures))
        draw_profile(figures["jobs"], _DOCS / "images" / "performance.png")
    print(json.dumps(figures, indent=1))  # noqa: T201  the command's output
    return 0


def _job(name: str, rounds: int) -> dict[str, Any]:
    """A whole job by the command line, its stages, and the floor, by turns."""
    lights = PAIRS[name].lights
    files = pair_files(name)
    whole, stages, floors = [], [], []
    for _ in range(rounds):
        whole.append(_separated(name))
        stages.append(_stages(name))
        floors.append(floor(*files, lights))
    used = medians(whole)
    by_stage = {key: median(one[key] for one in stages) for key in stages[0]}
    least = {key: median(one[key] for one in floors) for key in floors[0]}
    least["align"] = min(least["align"], by_stage["align"])  # ECC may take longer
    return {
        "cpu_s": used.cpu_s,
        "wall_s": used.wall_s,
        "peak_mb": used.peak_mb,
        "floor_ratio": used.cpu_s / sum(least.values()),
        "stages_cpu_s": by_stage,
        "floor_cpu_s": least,
    }


def _separated(name: str, *flags: str) -> Usage:
    """A job by the command line."""
    command = str(Path(sys.executable).with_name("lightlayers"))
    files, lights = map(str, pair_files(name)), str(PAIRS[name].lights)
    with tempfile.TemporaryDirectory() as folder:
        return run([command, "separate", *files, "-o", f"{folder}/out", "--lights", lights, *flags])


def _stages(name: str) -> dict[str, float]:
    with tempfile.TemporaryDirectory() as folder:
        said = Path(folder) / "stages.json"
        files = map(str, pair_files(name))
        arguments = ["-m", "tests.bench.stages", *files, str(PAIRS[name].lights), str(said)]
        run(python(*arguments))
        found: dict[str, float] = json.loads(said.read_text())
    return found


def _growth() -> dict[str, float]:
    """CPU of four times the pixels, and throughput of two jobs at once against one by one."""
    small, large, pairs = [], [], []
    for _ in range(_ROUNDS):
        small.append(_separated(_SMALL).cpu_s)
        large.append(_separated(_LARGE).cpu_s)
        pairs.append(tasks.two_at_once(pair_files(_LARGE), {"lights": PAIRS[_LARGE].lights}))
    return {
        "pixels4_cpu_ratio": median(large) / median(small),
        "parallel2_speedup": median(one["speedup"] for one in pairs),
        "parallel2_cpu_ratio": median(one["cpu_ratio"] for one in pairs),
    }


def _normals() -> dict[str, float]:
    """CPU of a job whose lamps have known directions, and of the same job without, by turns."""
    truth = drivers.simulated_truth(_OBJECTS)
    lights = [{"direction": direction.tolist()} for direction in truth.directions]
    with_normals, without = [], []
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "lights.json"
        file.write_text(json.dumps({"lights": lights}))
        for _ in range(_ROUNDS):
            with_normals.append(_separated(_FACING, "--light-directions", str(file)).cpu_s)
            without.append(_separated(_FACING).cpu_s)
    return {"cpu_s": median(with_normals), "without_cpu_s": median(without)}


if __name__ == "__main__":
    sys.exit(main())

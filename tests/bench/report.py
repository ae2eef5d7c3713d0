"""The figures as a page and a picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure

from tests.bench.pairs import PAIRS
from tests.evaluation.tables import Rows, markdown

_HEAD = Path(__file__).with_name("report_head.md")
_STAGES = ("imports", "decode", "align", "lamps", "layers", "encode")
_LIMITS: dict[str, tuple[float, float, float]] = {
    "jpeg12_n2": (3.0, 512, 1.5),
    "raw24_n3": (7.0, 1126, 1.5),
}
"""CPU seconds, MiB and the ratio to the floor that are asked for."""
_QUALITY = """\
Layers of RAW pairs of the simulated camera, 1200 × 800, against the truth, medians of three noises;
CPU of the 24 megapixel pair over that of `best`. `best` averages noise over 41 × 41
pixels, `balanced` over 17 × 17, `fast` over 7 × 7.
"""


def report(figures: dict[str, Any]) -> str:
    """docs/performance.md."""
    jobs = figures["jobs"]
    rows = [["asked or measured", "figure", "limit", "met"]]
    for name, (cpu, peak, ratio) in _LIMITS.items():
        one = jobs[name]
        rows += [
            _goal(f"{name}: CPU, s", one["cpu_s"], cpu),
            _goal(f"{name}: peak memory, MiB", one["peak_mb"], peak),
            _goal(f"{name}: CPU over the floor's", one["floor_ratio"], ratio),
        ]
    kernel, growth, align = figures["kernel"], figures["growth"], figures["align"]
    start = figures["start"]
    first, cpu = start["first_byte_s"], start["cpu_s"]
    rows += [
        _goal("task: start to first byte of work, s", first, 0.3),
        _goal("… the slowest, s", start["worst_first_byte_s"], 0.3),
        ["… over a bare Python's whole run", f"{first / start['bare_wall_s']:.2g}", "", ""],
        ["task: CPU of start and end, s", f"{cpu:.3f}", "", ""],
        ["… over a bare Python's", f"{cpu / start['bare_cpu_s']:.2g}", "", ""],
        _goal("per-pixel work: CPU over a copy of its bytes", kernel["memcpy_ratio"], 12),
        _goal("per-pixel work: times faster than NumPy", kernel["numpy_speedup"], 6, least=True),
        _goal("… than numpy.linalg.solve", kernel["solve_speedup"], 30, least=True),
        _goal("raw12_n3, with normals: CPU, s", figures["normals"]["cpu_s"], 60),
        ["… without", f"{figures['normals']['without_cpu_s']:.1f}", "", ""],
        _goal("four times the pixels: CPU", growth["pixels4_cpu_ratio"], 4.4),
        ["two jobs at once: throughput", f"{growth['parallel2_speedup']:.2f}", "", ""],
        ["… CPU over one after the other", f"{growth['parallel2_cpu_ratio']:.2f}", "", ""],
        ["alignment: error at the corners, px", f"{align['error_px']:.3f}", "", ""],
    ]
    if align["hugin_cpu_ratio"] is None:
        rows.append(["alignment beside align_image_stack", "not installed", "", ""])
    else:
        ratio, error = align["hugin_cpu_ratio"], align["hugin_error_px"]
        rows.append(_goal("align_image_stack: CPU over ours", ratio, 20, least=True))
        shown = "none found" if error is None else f"{error:.3f}"
        rows.append(["align_image_stack: error at the corners, px", shown, "", ""])
    return "\n".join(
        [
            _HEAD.read_text(),
            "## What is asked\n",
            markdown(rows),
            "\n## Jobs\n",
            markdown(_jobs(jobs)),
            "\n## Quality\n",
            _QUALITY,
            markdown(_by_quality(figures["quality"])),
            "\n## Stages\n",
            "CPU seconds of each stage, and of the leanest known route for it.\n",
            markdown(_by_stage(jobs)),
            "\n![CPU seconds by stage](images/performance.png)\n",
        ]
    )


def _goal(name: str, figure: float, limit: float, least: bool = False) -> list[str]:
    met = figure >= limit if least else figure <= limit
    sign = "≥" if least else "≤"
    return [name, f"{figure:.3g}", f"{sign} {limit:g}", "yes" if met else "**no**"]


def _jobs(jobs: dict[str, Any]) -> Rows:
    rows = [["pair", "megapixels", "lamps", "CPU, s", "wall, s", "peak, MiB", "CPU over floor"]]
    for name, one in jobs.items():
        made = PAIRS[name]
        shown = (f"{one[key]:.1f}" for key in ("cpu_s", "wall_s"))
        peak, ratio = f"{one['peak_mb']:.0f}", f"{one['floor_ratio']:.1f}"
        rows.append([name, f"{made.megapixels:g}", str(made.lights), *shown, peak, ratio])
    return rows


def _by_stage(jobs: dict[str, Any]) -> Rows:
    rows = [["pair", *_STAGES]]
    for name, one in jobs.items():
        for kind, key in (("", "stages_cpu_s"), (", floor", "floor_cpu_s")):
            seconds = (one[key].get(stage) for stage in _STAGES)
            rows.append([name + kind, *("" if s is None else f"{s:.2f}" for s in seconds)])
    return rows


def _by_quality(found: dict[str, Any]) -> Rows:
    rows = [["--quality", "two lamps, dB", "three lamps, dB", "CPU over best"]]
    for name, one in found.items():
        snr = (f"{one[key]:.1f}" for key in ("two_db", "three_db"))
        rows.append([name, *snr, f"{one['cpu_ratio']:.2f}"])
    return rows


def draw_profile(jobs: dict[str, Any], path: Path) -> None:
    """Bars of CPU seconds by stage, one for each job."""
    with mpl.rc_context({"svg.hashsalt": "lightlayers"}):
        figure = Figure(figsize=(8, 0.7 * len(jobs) + 1.2), layout="constrained")
        axes = figure.subplots()
        left = [0.0] * len(jobs)
        for stage in _STAGES:
            seconds = [one["stages_cpu_s"].get(stage, 0.0) for one in jobs.values()]
            axes.barh(list(jobs), seconds, left=left, label=stage)
            left = [a + b for a, b in zip(left, seconds, strict=True)]
        axes.invert_yaxis()
        axes.set_xlabel("CPU seconds")
        axes.legend(ncols=len(_STAGES), loc="upper center", bbox_to_anchor=(0.5, 1.25))
        figure.savefig(path, dpi=100, metadata={"Software": None})

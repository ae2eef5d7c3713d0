"""What calibration gains: separation with spectra assumed, calibrated and known; lamps of spheres.

On both halves this writes docs/calibration.md and its data. With --cameras or --set it prints.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import get_args

import numpy as np

from pipeline.arrays import Floats64
from pipeline.errors import InputError
from pipeline.options import Options
from pipeline.process import separate_files
from pipeline.progress import Progress
from pipeline.spectra.lights import find_light
from tests.evaluation.calibrated import (
    CAMERA,
    Assumed,
    cameras,
    flashes,
    measured_cameras,
    ways,
)
from tests.evaluation.capture import Capture, Sensor, capture
from tests.evaluation.environment import settle
from tests.evaluation.scenes import neutral_seen, render_seen, scenes
from tests.evaluation.scoring import balance_score, joint_snr, valid_pixels
from tests.evaluation.spectra import Split, sensitivities
from tests.evaluation.spheres import SphereFigure, measure_spheres, sphere_rows
from tests.evaluation.tables import Rows, markdown
from tests.layers import Planes, layers_of, picture, planes_of
from tests.targets import other_colorchecker, photograph_chart

_DOCS = Path(__file__).parents[2] / "docs"
_HEAD = Path(__file__).with_name("calibration_head.md")
_SCENES = 6
_REFUSED_DB, _REFUSED_DEG = 0.0, 20.0


@dataclass(frozen=True)
class Figure:
    """How good a scene's results are with what is assumed of camera and flash.

    snr_db, paper_db: joint SNR of the layers by the methods best and paper. colour_deg: median
    error of colour of white_balanced_1 by the method best.
    """

    split: Split
    unknown: str
    scene: str
    assumed: str
    snr_db: float
    paper_db: float
    colour_deg: float


def measure(split: Split, unknown: str, number: int, s: Floats64, flash: Floats64) -> list[Figure]:
    """Separate a scene with what is assumed, calibrated, and known of camera or flash, or both."""
    scene = scenes("two", split)[number]
    rendered = render_seen(scene, s, flash)
    taken = capture(rendered, Sensor())
    valid = valid_pixels(rendered.lamps, rendered.flash, 1.0)
    chart = photograph_chart(s, flash, find_light("A"), other_colorchecker(), 1.0, seed=number)
    neutral = neutral_seen(scene, s, rendered.lamps)
    found = []
    for name, assumed in ways(unknown, chart, s, flash).items():
        told = assumed()
        best = _separated(taken, {**told, "method": "best"})
        paper = _separated(taken, {**told, "method": "paper"})
        snr, paper_snr = (
            _REFUSED_DB if some is None else joint_snr(taken.truth, layers_of(some, 2), valid)[0]
            for some in (best, paper)
        )
        colour = _REFUSED_DEG
        if best is not None:
            colour = balance_score(neutral, picture(best), valid)[1]
        found.append(Figure(split, unknown, scene.name, name, snr, paper_snr, colour))
    return found


def _separated(taken: Capture, assumed: Assumed) -> Planes | None:
    """Channels of layers.exr, and R, G, B of white_balanced.exr; None where it is refused."""
    options = {
        "encoding": taken.encoding,
        "exposure_ratio": 1.0,
        "lights": 2,
        "outputs": ["layers.exr", "white_balanced.exr"],
        **assumed,
    }
    with tempfile.TemporaryDirectory() as folder:
        try:
            separate_files(
                taken.no_flash,
                taken.flash,
                Options.model_validate(options),
                Path(folder),
                Progress(),
            )
        except InputError:
            return None
        layers, balanced = (
            planes_of((Path(folder) / f"{name}.exr").read_bytes())
            for name in ("layers", "white_balanced")
        )
        return layers | balanced


def main() -> None:
    """Run what the arguments ask for."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.evaluation.calibration", description=__doc__
    )
    parser.add_argument("--set", choices=get_args(Split))
    parser.add_argument("--cameras", type=Path, help="folder of measured cameras, AMPAS JSON")
    arguments = parser.parse_args()
    settle()
    splits: tuple[Split, ...] = (arguments.set,) if arguments.set else get_args(Split)
    if arguments.cameras:
        found, spheres = _run(_of_folder(arguments.cameras, splits)), []
    else:
        found, spheres = _run(_jobs(splits)), measure_spheres(splits)
    tables = [markdown(rows(found, split)) for split in splits]
    tables += [markdown(sphere_rows(spheres, split)) for split in splits if spheres]
    sys.stdout.write("\n\n".join(tables) + "\n")
    if not (arguments.set or arguments.cameras):
        _write(found, spheres)


Job = tuple[Split, str, int, Floats64, Floats64]


def _jobs(splits: tuple[Split, ...]) -> list[Job]:
    jobs: list[Job] = []
    for split in splits:
        lights, seeing = flashes(split, _SCENES), cameras(split, _SCENES)
        for number in range(_SCENES):
            jobs.append((split, "flash", number, sensitivities(CAMERA), lights[number]))
            jobs.append((split, "camera", number, seeing[number], find_light("xenon")))
            jobs.append((split, "both", number, seeing[number], lights[number]))
    return jobs


def _of_folder(folder: Path, splits: tuple[Split, ...]) -> list[Job]:
    measured = measured_cameras(folder)
    return [
        (split, "camera", number % _SCENES, s, find_light("xenon"))
        for split in splits
        for number, s in enumerate(measured[:: max(1, len(measured) // _SCENES)])
    ]


def _run(jobs: list[Job]) -> list[Figure]:
    found: list[Figure] = []
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        for figures in pool.map(measure, *zip(*jobs, strict=True)):
            found += figures
            sys.stdout.write(f"{figures[0].unknown}  {figures[0].scene}  {_line(figures)}\n")
            sys.stdout.flush()
    return found


def _line(figures: list[Figure]) -> str:
    return "  ".join(
        f"{one.assumed} {one.snr_db:.1f} {one.paper_db:.1f} {one.colour_deg:.2f}°"
        for one in figures
    )


def rows(found: list[Figure], split: Split) -> Rows:
    """A row for what is unknown and what is told: median / worst of each figure."""
    table = [["unknown", "told", "best, dB", "paper, dB", "white balance, °"]]
    own = [one for one in found if one.split == split]
    for unknown, assumed in dict.fromkeys((one.unknown, one.assumed) for one in own):
        some = [one for one in own if (one.unknown, one.assumed) == (unknown, assumed)]
        cells = []
        for values in ([one.snr_db for one in some], [one.paper_db for one in some]):
            cells.append(f"{np.median(values):.1f} / {min(values):.1f}")
        colours = [one.colour_deg for one in some]
        cells.append(f"{np.median(colours):.2f} / {max(colours):.2f}")
        table.append([unknown, assumed, *cells])
    return table


def _write(found: list[Figure], spheres: list[SphereFigure]) -> None:
    parts = [_HEAD.read_text(encoding="utf-8").rstrip()]
    for split, title in (("report", "Report scenes"), ("development", "Development scenes")):
        of: Split = "report" if split == "report" else "development"
        parts += [
            f"## {title}",
            markdown(rows(found, of)),
            "Lamps found from a sphere:",
            markdown(sphere_rows(spheres, of)),
        ]
    (_DOCS / "calibration.md").write_text("\n\n".join(parts) + "\n", encoding="utf-8")
    figures = [
        {name: round(v, 3) if isinstance(v, float) else v for name, v in asdict(one).items()}
        for one in found
    ]
    angles = [
        {**asdict(one), "error_deg": None if one.error_deg is None else round(one.error_deg, 3)}
        for one in spheres
    ]
    text = json.dumps({"separation": figures, "spheres": angles}, indent=1, allow_nan=False)
    (_DOCS / "calibration.json").write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()

"""How well normals and depth are found, on rendered objects of known shape.

All conditions on the report objects write docs/normals.md and its data. Anything less prints.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any, get_args

import numpy as np
import tifffile

from pipeline.arrays import Floats64
from pipeline.decode import decode
from pipeline.errors import InputError
from pipeline.options import Options
from pipeline.process import separate_files
from pipeline.progress import Progress
from pipeline.vectors import unit
from tests.evaluation.baselines.woodham1980 import single_shot_normals
from tests.evaluation.environment import settle
from tests.evaluation.objects import CAMERA, OBJECTS, Kind, Object, ObjectShot, photograph
from tests.evaluation.spectra import Split, flash_spectrum, sensitivities
from tests.evaluation.tables import markdown
from tests.layers import planes_of
from tests.turned import turned

_DOCS = Path(__file__).parents[2] / "docs"
_HEAD = Path(__file__).with_name("normals_head.md")
_WRONG_DEG = 90.0  # of a refusal
_OUTPUTS = ["normals.exr", "depth.exr", "normals_confidence.tif"]  # the paper's has the first alone


@dataclass(frozen=True)
class Condition:
    """What the photographer has and says.

    lamps: which of the three are on. said: of each light. off_deg: of the directions.
    """

    kind: Kind = "measured"
    flash: str = "xenon"
    noise: bool = False
    said: tuple[str, ...] = ("direction", "strength", "rgb")
    lamps: tuple[int, ...] = (0, 1, 2)
    off_deg: float = 0.0


CONDITIONS = {
    "measured lamps": Condition(),
    "peaked lamps": Condition(kind="peaked"),
    "filtered lamps": Condition(kind="filtered"),
    "LED flash": Condition(flash="led"),
    "sensor noise": Condition(noise=True),
    "strengths unknown": Condition(said=("direction", "rgb")),
    "strengths unknown, noise": Condition(said=("direction", "rgb"), noise=True),
    "directions alone": Condition(said=("direction",)),
    "directions 10° off": Condition(off_deg=10.0),
    "two lamps": Condition(lamps=(0, 1)),
}


@dataclass(frozen=True)
class Figures:
    """Of one method on one object.

    error_deg: mean over the pixels that all lamps light. coverage: share of them that have a
    normal. depth_error: RMS over the object ÷ its relief, None without depth. unsure_deg, sure_deg:
    mean over the tenth of the object's pixels that confidence trusts least, and the half that it
    trusts most, None without confidence. cpu_s: processor time of everything, from files to files.
    """

    condition: str
    object: str
    materials: int
    method: str
    error_deg: float
    coverage: float
    depth_error: float | None
    unsure_deg: float | None
    sure_deg: float | None
    refusal: str
    cpu_s: float


@dataclass(frozen=True)
class Found:
    """What a method finds: normals (H, W, 3), depth (H, W), confidence (H, W) 0…1 of normals."""

    normals: Floats64
    depth: Floats64 | None = None
    confidence: Floats64 | None = None


Method = Callable[[ObjectShot, Condition], Found]


def _product(method: str) -> Method:
    def run(shot: ObjectShot, condition: Condition) -> Found:
        lights = [{name: shot.lights[j][name] for name in condition.said} for j in condition.lamps]
        options = Options.model_validate(
            {
                **shot.options,
                "method": method,
                "lights": len(lights),
                "light_directions": lights,
                "outputs": ["normals.exr"] if method == "paper" else _OUTPUTS,
            }
        )
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            separate_files(*shot.files, options, folder, Progress())
            planes = planes_of((folder / "normals.exr").read_bytes())
            normals = np.stack([planes[c] for c in "RGB"], axis=-1).astype(np.float64)
            if method == "paper":
                return Found(normals)
            depth = planes_of((folder / "depth.exr").read_bytes())["Z"].astype(np.float64)
            confidence = tifffile.imread(folder / "normals_confidence.tif") / 65535
        return Found(normals, depth, confidence)

    return run


def _single_shot(shot: ObjectShot, condition: Condition) -> Found:
    before, after = (decode(file, "linear", "photograph").pixels[:] for file in shot.files)
    white = sensitivities(CAMERA) @ flash_spectrum(condition.flash)
    surface = (after - before)[shot.lit].mean(axis=0) / white
    rgb = np.array([light["rgb"] for light in shot.lights])
    strengths = np.array([light["strength"] for light in shot.lights])
    colours = (rgb / rgb[:, 1:2] * strengths[:, None]).T
    directions = unit(np.array([light["direction"] for light in shot.lights]))
    even = before / (surface / surface[1]).astype(np.float32)
    return Found(single_shot_normals(even, colours, directions).astype(np.float64))


def _facing_camera(shot: ObjectShot, _: Condition) -> Found:
    return Found(np.broadcast_to([0.0, 0.0, 1.0], shot.normals.shape))


METHODS: dict[str, Method] = {
    "best": _product("best"),
    "paper": _product("paper"),
    "single shot": _single_shot,
    "facing the camera": _facing_camera,
}


def measure(name: str, thing: Object, split: Split, method: str) -> Figures:
    """Run one method on one object under a condition."""
    condition = CONDITIONS[name]
    shot = photograph(
        thing, split, condition.kind, condition.flash, condition.noise, condition.lamps
    )
    if condition.off_deg:
        shot = replace(shot, lights=_off(shot.lights, condition.off_deg))
    start = time.process_time()
    refusal = ""
    try:
        found = METHODS[method](shot, condition)
    except InputError as refused:
        found, refusal = Found(np.full(shot.normals.shape, np.nan)), str(refused)
    spent = time.process_time() - start
    cosine = np.clip((found.normals * shot.normals).sum(axis=2), -1, 1)
    degrees = np.degrees(np.arccos(cosine))
    known = shot.lit & np.isfinite(degrees)
    unsure, sure = _by_confidence(degrees, found.confidence)
    return Figures(
        condition=name,
        object=thing.name,
        materials=thing.materials,
        method=method,
        error_deg=float(degrees[known].mean()) if known.any() else _WRONG_DEG,
        coverage=float(known.sum() / shot.lit.sum()),
        depth_error=None if found.depth is None else _depth_error(found.depth, shot),
        unsure_deg=unsure,
        sure_deg=sure,
        refusal=refusal,
        cpu_s=spent,
    )


def _off(lights: list[dict[str, Any]], degrees: float) -> list[dict[str, Any]]:
    directions = turned(np.array([light["direction"] for light in lights]), degrees).tolist()
    return [{**light, "direction": one} for light, one in zip(lights, directions, strict=True)]


def _by_confidence(
    degrees: Floats64, confidence: Floats64 | None
) -> tuple[float, float] | tuple[None, None]:
    """Mean error of the tenth least trusted and of the half most trusted of all known pixels."""
    if confidence is None:
        return None, None
    known = np.isfinite(degrees)
    ordered = degrees[known][np.argsort(confidence[known], kind="stable")]
    tenth, half = len(ordered) // 10, len(ordered) // 2
    return float(ordered[:tenth].mean()), float(ordered[half:].mean())


def _depth_error(depth: Floats64, shot: ObjectShot) -> float:
    """RMS error over the object after the best scale, by the difference of far and near."""
    known = np.isfinite(shot.normals).all(axis=2) & np.isfinite(depth)
    true, found = shot.depth[known], depth[known]
    scale = (true @ found) / (found @ found)
    return float(np.sqrt(np.mean((scale * found - true) ** 2)) / np.ptp(true))


def main() -> None:
    """Run what the arguments ask for."""
    parser = argparse.ArgumentParser(prog="python -m tests.evaluation.normals", description=__doc__)
    parser.add_argument("--set", choices=get_args(Split), default="report")
    parser.add_argument("--condition", choices=CONDITIONS, action="append")
    parser.add_argument("--method", choices=METHODS, action="append")
    arguments = parser.parse_args()
    settle()
    jobs = [
        (name, thing, arguments.set, method)
        for name in arguments.condition or CONDITIONS
        for thing in OBJECTS[arguments.set]
        for method in arguments.method or METHODS
        if method in ("best", "facing the camera") or len(CONDITIONS[name].lamps) == 3
    ]
    found = []
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        for figures in pool.map(measure, *zip(*jobs, strict=True)):
            found.append(figures)
            sys.stdout.write(f"{_line(figures)}\n")
            sys.stdout.flush()
    table = markdown(rows(found))
    sys.stdout.write(f"\n{table}\n")
    if arguments.set == "report" and not (arguments.condition or arguments.method):
        _write(found, table)


def _line(figures: Figures) -> str:
    depth = "" if figures.depth_error is None else f"  depth {figures.depth_error:.2%}"
    if figures.unsure_deg is not None:
        depth += f"  least / most sure {figures.unsure_deg:.2f}° / {figures.sure_deg:.2f}°"
    return (
        f"{figures.condition}  {figures.object}  {figures.method}  {figures.error_deg:.2f}°  "
        f"coverage {figures.coverage:.3f}{depth}  {figures.refusal}"
    )


def rows(found: list[Figures]) -> list[list[str]]:
    """A row for each condition: median / worst error of each method, coverage and depth of best."""
    methods = [name for name in METHODS if any(one.method == name for one in found)]
    table = [["", *methods, "coverage", "depth, % of relief", "least / most sure"]]
    for name in dict.fromkeys(one.condition for one in found):
        own = [one for one in found if one.condition == name]
        row = [name]
        for method in methods:
            errors = [one.error_deg for one in own if one.method == method]
            row.append(f"{np.median(errors):.2f} / {max(errors):.2f}" if errors else "–")
        best = [one for one in own if one.method == "best"]
        depths = [100 * one.depth_error for one in best if one.depth_error is not None]
        row.append(f"{min(one.coverage for one in best):.3f}" if best else "–")
        row.append(f"{np.median(depths):.2f} / {max(depths):.2f}" if depths else "–")
        unsure, sure = (
            [value for one in best if (value := getattr(one, which)) is not None]
            for which in ("unsure_deg", "sure_deg")
        )
        row.append(f"{np.median(unsure):.2f} / {np.median(sure):.2f}" if unsure else "–")
        table.append(row)
    return table


def _write(found: list[Figures], table: str) -> None:
    best = {(one.object, one.condition): one for one in found if one.method == "best"}
    errors, depths = [["object", "colours", *CONDITIONS]], [["object", "colours", *CONDITIONS]]
    for thing in OBJECTS["report"]:
        own = [best[thing.name, name] for name in CONDITIONS]
        first = [thing.name, str(thing.materials)]
        errors.append([*first, *(f"{one.error_deg:.2f}" for one in own)])
        depths.append([*first, *map(_depth_percent, own)])
    parts = [
        _HEAD.read_text(encoding="utf-8").rstrip(),
        table,
        "## Every object\n\nMean error of `best` in degrees.",
        markdown(errors),
        "RMS error of its depth in % of the relief.",
        markdown(depths),
    ]
    (_DOCS / "normals.md").write_text("\n\n".join(parts) + "\n", encoding="utf-8")
    text = json.dumps([_rounded(one) for one in found], indent=1, allow_nan=False)
    (_DOCS / "normals.json").write_text(text + "\n", encoding="utf-8")


def _depth_percent(figures: Figures) -> str:
    return "–" if figures.depth_error is None else f"{100 * figures.depth_error:.2f}"


def _rounded(figures: Figures) -> dict[str, Any]:
    values = asdict(replace(figures, cpu_s=round(figures.cpu_s)))
    return {name: round(v, 4) if isinstance(v, float) else v for name, v in values.items()}


if __name__ == "__main__":
    main()

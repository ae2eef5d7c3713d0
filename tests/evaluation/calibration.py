"""What calibration gains: separation with spectra assumed, calibrated and known; lamps of spheres.

On both halves this writes docs/calibration.md and its data. With --cameras or --set it prints.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from pipeline.calibration.calibrate import FILES, calibrate_files
from pipeline.calibration.options import CALIBRATION_OPTIONS
from pipeline.errors import InputError
from pipeline.options import Options, Sensitivities, Spectrum
from pipeline.process import separate_files
from pipeline.progress import Progress
from pipeline.spectra.cameras import _from_table
from pipeline.spectra.grid import WAVELENGTHS_NM
from pipeline.spectra.lights import find_light
from pipeline.spectra.tables import parse_sensitivities, parse_spectrum
from pipeline.vectors import unit
from tests.evaluation.capture import Capture, Sensor, capture
from tests.evaluation.product import Planes, picture, planes_of
from tests.evaluation.scenes import neutral_seen, render_seen, scenes
from tests.evaluation.scoring import balance_score, joint_snr, valid_pixels
from tests.evaluation.spectra import Split, lamps, reflectances, sensitivities
from tests.evaluation.tables import markdown
from tests.targets import (
    CIRCLE,
    CORNERS,
    FOCAL_PX,
    Shot,
    other_colorchecker,
    photograph_chart,
    photograph_sphere,
)

Array = NDArray[np.float64]

_DOCS = Path(__file__).parents[2] / "docs"
_HEAD = Path(__file__).with_name("calibration_head.md")
_SCENES, _SPHERES = 6, 8
_CAMERA = "Nikon D5100"
_CARD = {"x": 30.0, "y": 120.0, "radius": 15.0}  # grey wall beside the chart
_REFUSED_DB, _REFUSED_DEG = 0.0, 20.0

Assumed = Mapping[str, Any]
"""Values of Options for camera and flash."""


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


@dataclass(frozen=True)
class SphereFigure:
    """Errors of the lamps' directions from one sphere, None where it was refused."""

    split: Split
    lamps: int
    noise: bool
    error_deg: float | None
    found: int


def _flashes(split: Split) -> list[Array]:
    """Measured white LEDs like those of phones, and xenon light off nearly white surfaces."""
    own = lamps(split)
    white = [i for i, name in enumerate(own.names) if "LED Phosphor" in name]
    cool = sorted(white, key=lambda i: -_blue_to_red(own.spectra[i]))[: _SCENES // 2]
    table = reflectances(split)
    pale = np.argsort(table.std(axis=1) / table.mean(axis=1) - 0.5 * table.min(axis=1))[
        : _SCENES // 2
    ]
    bounced = [find_light("xenon") * table[place] ** 2 for place in pale]
    mixed = [light for two in zip(own.spectra[cool], bounced, strict=True) for light in two]
    return [light / light.sum() for light in mixed]


def _blue_to_red(spectrum: Array) -> float:
    blue, red = (WAVELENGTHS_NM < 500), (WAVELENGTHS_NM >= 580)
    return float(spectrum[blue].sum() / spectrum[red].sum())


def _cameras(split: Split) -> list[Array]:
    """Cameras as far from the assumed one as measured ones are (3, W): shifted, tinted, scaled."""
    random = np.random.default_rng(5 if split == "report" else 3)
    base = sensitivities(_CAMERA)
    distance = np.square((WAVELENGTHS_NM[:, None] - WAVELENGTHS_NM) / 60.0)
    root = np.linalg.cholesky(np.exp(-0.5 * distance) + 1e-9 * np.eye(len(WAVELENGTHS_NM)))
    made = []
    for _ in range(_SCENES):
        channels = []
        for channel in base:
            shifted = np.interp(
                WAVELENGTHS_NM - 6.0 * random.standard_normal(), WAVELENGTHS_NM, channel
            )
            tint = np.exp(0.25 * root @ random.standard_normal(len(shifted)))
            channels.append(shifted * tint * np.exp(0.2 * random.standard_normal()))
        made.append(np.array(channels) / np.max(channels))
    return made


def _measured(folder: Path) -> list[Array]:
    """Every camera of a folder of AMPAS JSON."""
    return [
        _from_table(path.stem, parse_sensitivities(path.read_bytes()), "file").sensitivities
        for path in sorted(folder.glob("*.json"))
        if "Nikon_D5100" not in path.stem
    ]


def measure(split: Split, unknown: str, number: int, s: Array, flash: Array) -> list[Figure]:
    """Separate a scene with what is assumed, calibrated, and known of camera or flash, or both."""
    scene = scenes("two", split)[number]
    rendered = render_seen(scene, s, flash)
    taken = capture(rendered, Sensor())
    valid = valid_pixels(rendered.lamps, rendered.flash, 1.0)
    chart = photograph_chart(s, flash, find_light("A"), other_colorchecker(), 1.0, seed=number)
    neutral = neutral_seen(scene, s, rendered.lamps)
    found = []
    for name, assumed in _ways(unknown, chart, s, flash).items():
        told = assumed()
        best = _separated(taken, {**told, "method": "best"})
        paper = _separated(taken, {**told, "method": "paper"})
        snr, paper_snr = (
            _REFUSED_DB if some is None else joint_snr(taken.truth, _layers(some), valid)[0]
            for some in (best, paper)
        )
        colour = _REFUSED_DEG
        if best is not None:
            colour = balance_score(neutral, picture(best, ""), valid)[1]
        found.append(Figure(split, unknown, scene.name, name, snr, paper_snr, colour))
    return found


def _layers(planes: Planes) -> NDArray[np.float32]:
    return np.stack([picture(planes, f"lamp{i}.") for i in (1, 2)])


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
        layers = planes_of(Path(folder) / "layers.exr")
        return layers | planes_of(Path(folder) / "white_balanced.exr")


def _ways(unknown: str, chart: Shot, s: Array, flash: Array) -> dict[str, Callable[[], Assumed]]:
    """What may be assumed, by name. One of them is what is true."""
    camera, light = _sensitivities(s), _spectrum(flash)
    truth = {"camera": camera, "flash_spectrum": light}
    corners = {"chart": CORNERS}
    if unknown == "flash":
        known = {"camera": camera}
        return {
            "assumed": lambda: {**known, "flash_spectrum": "xenon"},
            "grey card": lambda: {**known, **_found("flash", chart, card=_CARD, **known)},
            "ColorChecker": lambda: {**known, **_found("flash", chart, **corners, **known)},
            "true": lambda: truth,
        }
    if unknown == "camera":
        told = {"flash_spectrum": light}
        return {
            "assumed": lambda: {**told, "camera": _CAMERA},
            "ColorChecker": lambda: {**told, **_found("camera", chart, **corners, **told)},
            "ColorChecker, flash not told": lambda: {
                **told,
                **_found("camera", chart, **corners),
            },
            "true": lambda: truth,
        }

    def both() -> Assumed:
        found = _found("camera", chart, **corners)
        return {**found, **_found("flash", chart, **corners, **found)}

    return {
        "assumed": lambda: {"camera": _CAMERA, "flash_spectrum": "xenon"},
        "ColorChecker": both,
        "true": lambda: truth,
    }


def _found(kind: str, shot: Shot, **marks: Any) -> Assumed:
    """What calibrating gives, as values of Options."""
    options = CALIBRATION_OPTIONS.validate_python(
        {"kind": kind, "encoding": "linear", "exposure_ratio": 1.0, **marks}
    )
    with tempfile.TemporaryDirectory() as name:
        calibrate_files(*shot.files, options, Path(name), Progress())
        data = (Path(name) / FILES[kind]).read_bytes()
    if kind == "camera":
        return {"camera": parse_sensitivities(data)}
    if kind == "flash":
        return {"flash_spectrum": parse_spectrum(data)}
    return {"light_directions": json.loads(data)["lights"]}


def _sensitivities(s: Array) -> Sensitivities:
    r, g, b = s.tolist()
    return Sensitivities(wavelength_nm=WAVELENGTHS_NM.tolist(), r=r, g=g, b=b)


def _spectrum(flash: Array) -> Spectrum:
    return Spectrum(wavelength_nm=WAVELENGTHS_NM.tolist(), power=flash.tolist())


def measure_sphere(split: Split, count: int, noise: bool, number: int) -> SphereFigure:
    """Find lamps at random places, their number not told, from an outline marked a pixel off."""
    random = np.random.default_rng([number, count, 7 if split == "report" else 2])
    while True:
        directions = unit(random.standard_normal((count, 3)) * [1, 0.8, 0.6] + [0, 0.2, 0.6])
        cosines = directions @ directions.T - 2 * np.eye(count)
        if directions[:, 2].min() > -0.1 and cosines.max() < np.cos(np.radians(30)):
            break
    spectra = lamps(split).spectra[random.choice(len(lamps(split).names), count, replace=False)]
    colours = spectra @ sensitivities(_CAMERA).T
    colours *= random.uniform(0.25, 0.5, (count, 1)) / colours[:, 1:2]
    shot = photograph_sphere(directions, colours, float(noise), paint=0.02, seed=number)
    dx, dy, wider = random.normal(0, 1.0, 3)
    circle = {
        "x": CIRCLE["x"] + dx,
        "y": CIRCLE["y"] + dy,
        "radius": CIRCLE["radius"] + wider,
    }
    try:
        found = _found("lamps", shot, sphere=circle, focal_px=FOCAL_PX)["light_directions"]
    except InputError:
        return SphereFigure(split, count, noise, None, 0)
    towards = unit(np.array([light["direction"] for light in found]))
    if len(towards) != count:
        return SphereFigure(split, count, noise, None, len(towards))
    angles = np.degrees(np.arccos(np.clip(directions @ towards.T, -1, 1)))
    return SphereFigure(split, count, noise, float(angles.min(axis=1).max()), count)


def main() -> None:
    """Run what the arguments ask for."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.evaluation.calibration", description=__doc__
    )
    parser.add_argument("--set", choices=get_args(Split))
    parser.add_argument("--cameras", type=Path, help="folder of measured cameras, AMPAS JSON")
    arguments = parser.parse_args()
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    os.environ.pop("LIGHTLAYERS_SPECTRA", None)  # measured cameras are not to be known
    splits: tuple[Split, ...] = (arguments.set,) if arguments.set else get_args(Split)
    if arguments.cameras:
        found, spheres = _run(_of_folder(arguments.cameras, splits)), []
    else:
        found, spheres = _run(_jobs(splits)), _run_spheres(splits)
    tables = [markdown(rows(found, split)) for split in splits]
    tables += [markdown(sphere_rows(spheres, split)) for split in splits if spheres]
    sys.stdout.write("\n\n".join(tables) + "\n")
    if not (arguments.set or arguments.cameras):
        _write(found, spheres)


Job = tuple[Split, str, int, Array, Array]


def _jobs(splits: tuple[Split, ...]) -> list[Job]:
    jobs: list[Job] = []
    for split in splits:
        flashes, cameras = _flashes(split), _cameras(split)
        for number in range(_SCENES):
            jobs.append((split, "flash", number, sensitivities(_CAMERA), flashes[number]))
            jobs.append((split, "camera", number, cameras[number], find_light("xenon")))
            jobs.append((split, "both", number, cameras[number], flashes[number]))
    return jobs


def _of_folder(folder: Path, splits: tuple[Split, ...]) -> list[Job]:
    measured = _measured(folder)
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
            line = "  ".join(
                f"{one.assumed} {one.snr_db:.1f} {one.paper_db:.1f} {one.colour_deg:.2f}°"
                for one in figures
            )
            sys.stdout.write(f"{figures[0].unknown}  {figures[0].scene}  {line}\n")
            sys.stdout.flush()
    return found


def _line(figures: list[Figure]) -> str:
    return "  ".join(
        f"{one.assumed} {one.snr_db:.1f} {one.paper_db:.1f} {one.colour_deg:.2f}°"
        for one in figures
    )


def _run_spheres(splits: tuple[Split, ...]) -> list[SphereFigure]:
    jobs = [
        (split, count, noise, number)
        for split in splits
        for count in (1, 2, 3)
        for noise in (False, True)
        for number in range(_SPHERES)
    ]
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        return list(pool.map(measure_sphere, *zip(*jobs, strict=True)))


def rows(found: list[Figure], split: Split) -> list[list[str]]:
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


def sphere_rows(found: list[SphereFigure], split: Split) -> list[list[str]]:
    """A row for each number of lamps and noise: median / worst of the worst lamp's error."""
    table = [["lamps", "noise", "spheres", "refused", "other number", "median / worst error, °"]]
    own = [one for one in found if one.split == split]
    for count, noise in dict.fromkeys((one.lamps, one.noise) for one in own):
        some = [one for one in own if (one.lamps, one.noise) == (count, noise)]
        errors = [one.error_deg for one in some if one.error_deg is not None]
        table.append(
            [
                str(count),
                "of a sensor" if noise else "none",
                str(len(some)),
                str(sum(one.found == 0 for one in some)),
                str(sum(one.found not in (0, count) for one in some)),
                f"{np.median(errors):.2f} / {max(errors):.2f}" if errors else "–",
            ]
        )
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

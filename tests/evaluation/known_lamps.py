"""How well lamps are named, and what a pinned lamp gives, on rendered scenes with sensor noise.

The report scenes write docs/known_lamps.md. The development scenes print.
"""

from __future__ import annotations

import argparse
import statistics
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Literal, get_args

import cv2
import numpy as np

from pipeline.arrays import Floats64
from pipeline.decode import decode
from pipeline.errors import InputError
from pipeline.lamps.contradictions import contradictions
from pipeline.lamps.known_lamps import find_known
from pipeline.light.model import build_model
from pipeline.matrixfit.evidence import gather_evidence
from pipeline.matrixfit.fit import Fit, FitInput, fit_matrices, fit_pools, follow_outwards
from pipeline.matrixfit.known import Known, nothing_known
from pipeline.options import Options
from pipeline.spectra.cameras import find_camera
from pipeline.spectra.families import FAMILIES, family_spectra
from pipeline.spectra.lights import find_light
from pipeline.vectors import unit
from tests.evaluation.ceilings import dealt_out
from tests.evaluation.conditions import Condition, make_shot
from tests.evaluation.environment import settle
from tests.evaluation.scenes import NEUTRAL, Scene, scenes
from tests.evaluation.scoring import joint_snr
from tests.evaluation.shots import Shot
from tests.evaluation.spectra import Split
from tests.evaluation.tables import Rows, aligned, markdown

Kind = Literal["right", "mixed", "absent"]

GROUPS = {"one": 12, "two": 8, "three": 4, "smooth-two": 6}
"""How many scenes of each."""
_DOCS = Path(__file__).parents[2] / "docs"
_HEAD = Path(__file__).with_name("known_lamps_head.md")
_TWIN_COSINE = 0.999
_RADIUS = 4  # pixels: a fingertip on the picture
_PURE, _MIXED = 0.95, 0.3  # share of the light that is the lamp's
_LIT = 0.1  # of the scene's light where it is bright
_BINS = (0.0, 0.4, 0.6, 0.8, 1.0)
_KINDS = (
    ("Fluorescent", "fluorescent"),
    ("Incandescent", "incandescent"),
    ("LED Hybrid", "white LED"),
    ("LED Phosphor", "white LED"),
    ("LED Mixed", "RGB LED"),
    ("HPS", "sodium"),
    ("Metal Halide", "mercury or metal halide"),
    ("Mercury", "mercury or metal halide"),
)
"""What the names of the table of lamps say; a plasma lamp is of no family."""


@dataclass(frozen=True)
class Named:
    """A lamp, its family, and what the product says."""

    family: str
    said: str
    confidence: float


@dataclass(frozen=True)
class Pinned:
    """A scene without a pin and with one, the number of lamps told.

    kind: whether the pin is right, in the light of several lamps, or of a lamp that is not there.
    snr_db: joint SNR without, with. warned: whether the pin is doubted.
    """

    scene: str
    kind: Kind
    snr_db: tuple[float, float]
    warned: bool


def family_of(name: str) -> str | None:
    """The family of a lamp by its name in the table, None for one of no family."""
    return next((family for part, family in _KINDS if part in name), None)


def purest_place(shot: Shot, lamp: int) -> tuple[tuple[float, float], float]:
    """(x, y) of the middle of the area that a lamp lights most alone, and its least share there.

    Such a place is seen in a photograph without help. What the truth knows is used for nothing
    else.
    """
    share, light = _shares(shot)
    score = _least(share[lamp]) * (light > _LIT * np.percentile(light, 90))
    y, x = np.unravel_index(int(score.argmax()), score.shape)
    return (x + 0.5, y + 0.5), float(score.max())


def mixed_place(shot: Shot) -> tuple[float, float] | None:
    """(x, y) of an area where every pixel has the light of several lamps, None where none is."""
    share, light = _shares(shot)
    second = np.sort(share, axis=0)[-2]
    score = _least(second) * (light > _LIT * np.percentile(light, 90))
    y, x = np.unravel_index(int(score.argmax()), score.shape)
    return (x + 0.5, y + 0.5) if score.max() > _MIXED else None


def measure(scene: Scene) -> tuple[list[Named], list[Pinned]]:
    """What is said of a scene's lamps, and what pins change."""
    shot = make_shot(scene, Condition(files="noisy"))
    camera = find_camera(scene.camera, decode(shot.files[0], shot.options["encoding"], "file"))
    model = build_model(camera, shot.flash_spectrum, find_light(NEUTRAL), "wpca")
    evidence = gather_evidence(shot.reduced)

    def fit(known: Known) -> tuple[Fit, float, tuple[int, ...]]:
        given = FitInput(shot.reduced, evidence, model, known)
        usual = fit_pools(given, fit_matrices(given, shot.count))
        found = follow_outwards(given, usual)
        layers = dealt_out(shot.photograph, *shot.filtered, found.matrices)
        return found, *joint_snr(shot.truth, layers, shot.valid)

    free, before, order = fit(nothing_known(model.flash_white))
    named = []
    for name, spectrum, at in zip(scene.lamp_names, scene.lamp_spectra, order, strict=True):
        family = family_of(name)
        if family is not None and not _is_known(spectrum):
            named.append(Named(family, *model.families.nearest(free.matrices[at])))

    pins: list[tuple[Kind, Any]] = []
    if shot.count > 1:
        place, purity = max((purest_place(shot, lamp) for lamp in range(shot.count)), key=_purity)
        if purity > _PURE:
            pins.append(("right", _area(place)))
        place_of_several = mixed_place(shot)
        if place_of_several is not None:
            pins.append(("mixed", _area(place_of_several)))
        pins.append(("absent", _absent(scene)))
    pinned = []
    for kind, pin in pins:
        options = Options.model_validate({**shot.options, "pinned_lamps": [pin]})
        try:
            known = find_known(options, shot.reduced, model)
        except InputError:
            continue  # the area is dark, or clipped
        found, after, _ = fit(known)
        said = contradictions(FitInput(shot.reduced, evidence, model, known), found, free)
        pinned.append(Pinned(scene.name, kind, (before, after), bool(said)))
    return named, pinned


def _purity(place: tuple[tuple[float, float], float]) -> float:
    return place[1]


def _absent(scene: Scene) -> str:
    """The measured flash or lamp whose spectrum is least like any of the scene's."""
    known = {"HPS": "sodium", "D150": "daylight", "A": "incandescent", "FL2": "fluorescent"}
    lamps = unit(scene.lamp_spectra)
    return min(known, key=lambda name: float((lamps @ unit(find_light(name))).max()))


def _area(place: tuple[float, float]) -> dict[str, float]:
    return {"x": place[0], "y": place[1], "radius": _RADIUS}


def _shares(shot: Shot) -> tuple[Floats64, Floats64]:
    """Share (N, H, W) of each lamp in usable pixels, 0 elsewhere, and all light (H, W)."""
    light = shot.truth.sum(axis=3)
    total = light.sum(axis=0)
    usable = shot.valid & shot.usable
    return np.where(usable, light / np.maximum(total, 1e-9), 0.0), total


def _least(share: Floats64) -> Floats64:
    """Least share within the disc about each pixel."""
    side = 2 * _RADIUS + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    return np.asarray(cv2.erode(share, disc, borderValue=0))


def _is_known(spectrum: Floats64) -> bool:
    """Whether the families were learnt from a lamp just like it."""
    known = unit(np.concatenate(list(family_spectra().values())))
    return bool((known @ unit(spectrum)).max() > _TWIN_COSINE)


def family_rows(named: list[Named]) -> Rows:
    """A row per range of confidence: lamps, how many are named right, mean confidence."""
    rows = [["confidence", "lamps", "right", "mean confidence"]]
    ranges = [*pairwise(_BINS), (_BINS[0], _BINS[-1])]
    for low, high in ranges:
        own = [
            one for one in named if low <= one.confidence and (one.confidence < high or high == 1)
        ]
        if own:
            right = statistics.mean(one.said == one.family for one in own)
            mean = statistics.mean(one.confidence for one in own)
            rows.append([f"{low:g} … {high:g}", str(len(own)), f"{right:.0%}", f"{mean:.2f}"])
    return rows


def confusion_rows(named: list[Named]) -> Rows:
    """A row per family that lamps are of, a column per family that is said."""
    rows = [["family", *FAMILIES]]
    for family in FAMILIES:
        said = [one.said for one in named if one.family == family]
        if said:
            rows.append([family, *(str(said.count(other)) for other in FAMILIES)])
    return rows


def pin_rows(pinned: list[Pinned]) -> Rows:
    """A row per kind of pin; of right ones, one more for the third of scenes worst without."""
    figures = ("without, dB", "with, dB", "median gain, dB", "worst, dB", "warned of")
    rows = [["pin", "pins", *figures]]
    right = sorted((one for one in pinned if one.kind == "right"), key=lambda one: one.snr_db[0])
    kinds = {kind: [one for one in pinned if one.kind == kind] for kind in get_args(Kind)}
    for name, own in {"right, worst third": right[: len(right) // 3], **kinds}.items():
        if not own:
            continue
        gains = [one.snr_db[1] - one.snr_db[0] for one in own]
        rows.append(
            [
                name,
                str(len(own)),
                *(f"{statistics.median(one.snr_db[i] for one in own):.1f}" for i in (0, 1)),
                f"{statistics.median(gains):+.1f}",
                f"{min(gains):+.1f}",
                f"{statistics.mean(one.warned for one in own):.0%}",
            ]
        )
    return rows


def main() -> None:
    """Run what the arguments ask for."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.evaluation.known_lamps", description=__doc__
    )
    parser.add_argument("--set", choices=get_args(Split), default="report")
    arguments = parser.parse_args()
    settle()
    named: list[Named] = []
    pinned: list[Pinned] = []
    every = [one for group, most in GROUPS.items() for one in scenes(group, arguments.set)[:most]]
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        for scene, (lamps, pins) in zip(every, pool.map(measure, every), strict=True):
            named += lamps
            pinned += pins
            sys.stdout.write(f"{scene.name}\n" + "".join(f"  {one}\n" for one in (*lamps, *pins)))
            sys.stdout.flush()
    tables = [family_rows(named), confusion_rows(named), pin_rows(pinned)]
    for table in tables:
        sys.stdout.write(f"\n{aligned(table)}\n")
    if arguments.set == "report":
        head, between, after = _HEAD.read_text(encoding="utf-8").strip().split("\n\n---\n\n")
        text = [head, markdown(tables[0]), between, markdown(tables[1]), after, markdown(tables[2])]
        (_DOCS / "known_lamps.md").write_text("\n\n".join(text) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()

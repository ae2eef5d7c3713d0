"""How well a photograph is shown through another camera, against a rendering by that camera.

The report half writes docs/editing.md and its data when every camera is there. Two cameras are
packaged; the others come from the folder that LIGHTLAYERS_SPECTRA names, a copy of rawtoaces-data.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import tempfile
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any, get_args

import numpy as np

from pipeline.arrays import Floats, Floats64
from pipeline.errors import InputError
from pipeline.options import Options
from pipeline.process import separate_files
from pipeline.progress import Progress
from pipeline.spectra.colorimetry import camera_to_xyz
from pipeline.spectra.colour_science import colour_science, without_warnings
from pipeline.spectra.folder import folder_spectra
from pipeline.spectra.lights import find_light, reflectance_spectra
from pipeline.spectra.matrices import best_matrix
from tests.evaluation.conditions import Condition, make_shot
from tests.evaluation.environment import settle
from tests.evaluation.scenes import SIZE, Scene, render_response, scenes
from tests.evaluation.scoring import joint_snr
from tests.evaluation.shots import Shot
from tests.evaluation.spectra import CAMERAS, Split, sensitivities, table
from tests.evaluation.tables import markdown
from tests.layers import layers_of, planes_of

Layers = Floats

_DOCS = Path(__file__).parents[2] / "docs"
_HEAD = Path(__file__).with_name("editing_head.md")
_DAYLIGHT = "D65"
_WRONG_DEG, _WRONG_DELTA_E = 90.0, 100.0  # of a refusal
_LEAST_SHARE = 0.1  # of a pixel's light, for a lamp's layer to count there
_WHITE = 99.0  # percentile of the light that is shown as white
_DARK = 1e-3  # of that, where no lamp's light arrives

_PACKAGED = (("Nikon D5100", "Sigma SD1 Merrill"), ("Sigma SD1 Merrill", "Nikon D5100"))
PAIRS: dict[Split, tuple[tuple[str, str], ...]] = {
    "development": (
        *_PACKAGED,
        ("Nikon D5100", "Canon EOS 5D Mark II"),
        ("Nikon D5100", "ARRI D21"),
        ("Canon EOS 5D Mark II", "Sony ILCE-7M3"),
        ("Canon EOS 5D Mark II", "Fujifilm X-T3"),
        ("Sony ILCE-7M3", "Nikon D700"),
        ("Sony ILCE-7M3", "Hasselblad L1D-20c"),
    ),
    "report": (
        *_PACKAGED,
        ("Nikon D5100", "Canon EOS 600D"),
        ("Nikon D5100", "Fujifilm GFX 100"),
        ("Canon EOS 600D", "Nikon D5100"),
        ("Canon EOS R6", "Sony ILCE-9"),
        ("Sony ILCE-9", "Nikon D850"),
        ("Nikon D850", "Canon PowerShot S90"),
        ("Fujifilm X-T4", "Canon EOS R6"),
        ("Sony ILCE-6400", "Hasselblad L2D-20c"),
    ),
}
"""Cameras that take the photograph, and through which it is shown."""

METHODS = ("best", "paper", "daylight matrix", "unchanged", "known lamps")


@dataclass(frozen=True)
class Figures:
    """Of one method on one scene.

    photograph_deg: mean angle between colours over the pixels that count. layers_deg: the same of
    the lamps' layers, where they give a tenth of the light or more, mean over the lamps.
    delta_e: mean CIEDE2000 of the photograph.
    """

    taken: str
    shown: str
    scene: str
    method: str
    photograph_deg: float
    layers_deg: float
    delta_e: float
    refusal: str = ""


def pairs(split: Split) -> tuple[tuple[str, str], ...]:
    """Those of PAIRS whose cameras are there."""
    known = {*CAMERAS, *folder_spectra()}
    return tuple(pair for pair in PAIRS[split] if known.issuperset(pair))


def scenes_of(number: int, split: Split) -> list[Scene]:
    """Two scenes with two lamps and one with three, other ones for every pair of cameras."""
    two, three = scenes("two", split), scenes("three", split)
    return [*two[2 * number : 2 * number + 2], three[number]]


def measure(scene: Scene, taken: str, shown: str, size: tuple[int, int] = SIZE) -> list[Figures]:
    """Run all methods on a scene, photographed by one camera and shown through another."""
    scene = replace(scene, camera=taken)
    shot = make_shot(scene, Condition(size=size))
    shot = replace(shot, options={**shot.options, "camera": table(taken)})
    truth = render_response(scene, shown, size)
    lit = truth.sum(axis=(0, 3))
    counts = shot.valid & (lit > _DARK * np.percentile(lit, _WHITE))
    wanted = truth[:, counts].astype(np.float64)
    whole = wanted.sum(axis=0)
    of_lamp = wanted.sum(axis=2) > _LEAST_SHARE * whole.sum(axis=1)
    to_lab = _to_lab(whole, _exposed_alike(taken, shown))
    found: list[Figures] = []
    for method, layers in _answers(shot, taken, shown).items():
        wrong = Figures(taken, shown, scene.name, method, _WRONG_DEG, _WRONG_DEG, _WRONG_DELTA_E)
        if isinstance(layers, str):
            found.append(replace(wrong, refusal=layers))
            continue
        seen = layers[:, counts].astype(np.float64)
        of_layers = [
            _angles(one[own], other[own]).mean()
            for one, other, own in zip(wanted, seen, of_lamp, strict=True)
            if own.any()
        ]
        found.append(
            replace(
                wrong,
                photograph_deg=float(_angles(whole, seen.sum(axis=0)).mean()),
                layers_deg=float(np.mean(of_layers)),
                delta_e=_delta_e(to_lab(whole), to_lab(seen.sum(axis=0))),
            )
        )
    return found


def _answers(shot: Shot, taken: str, shown: str) -> dict[str, Layers | str]:
    """Layers (N, H, W, 3) by every method in the order of the lamps, or why there are none."""
    out: dict[str, Layers | str] = {}
    plain = shot.truth
    for method in ("best", "paper"):
        try:
            own, edited = _product(shot, method, shown)
        except InputError as refused:
            out[method] = str(refused)
            continue
        _, order = joint_snr(shot.truth, own, shot.valid)
        out[method] = edited[list(order)]
        if method == "best":
            plain = own[list(order)]
    here, there = sensitivities(taken), _exposed_alike(taken, shown)
    daylight = find_light(_DAYLIGHT)
    known = np.array([best_matrix(here * lamp, there * lamp) for lamp in shot.lamp_spectra])
    out["daylight matrix"] = plain @ best_matrix(here * daylight, there * daylight).T
    out["unchanged"] = plain
    out["known lamps"] = np.einsum("nhwl,nkl->nhwk", plain, known)
    return out


def _product(shot: Shot, method: str, shown: str) -> tuple[Layers, Layers]:
    """Layers (N, H, W, 3) as the camera took them, and as the other one would have."""
    options = Options.model_validate(
        {
            **shot.options,
            "lights": shot.lights,
            "method": method,
            "response": table(shown),
            "outputs": ["layers.exr", "response.exr"],
        }
    )
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        separate_files(*shot.files, options, folder, Progress())
        taken, edited = (
            layers_of(planes_of((folder / file).read_bytes()), shot.count)
            for file in ("layers.exr", "response.exr")
        )
    return taken, edited


def _exposed_alike(taken: str, shown: str) -> Floats64:
    """Sensitivities (3, W) of the other camera, its green response to D65 that of the first."""
    daylight = find_light(_DAYLIGHT)
    here, there = sensitivities(taken), sensitivities(shown)
    return np.asarray(there * (here[1] @ daylight) / (there[1] @ daylight))


def _angles(wanted: Floats64, seen: Floats64) -> Floats64:
    """Angles in degrees between colours (n, 3), 90 where none is seen."""
    across = np.linalg.norm(np.cross(seen, wanted), axis=1)
    angles = np.degrees(np.arctan2(across, (seen * wanted).sum(axis=1)))
    return np.where(seen.any(axis=1), angles, _WRONG_DEG)


def _to_lab(photograph: Floats64, camera: Floats64) -> Callable[[Floats64], Floats64]:
    """From RGB (n, 3) of the other camera to CIE L*a*b*, the photograph's bright parts white."""
    daylight = find_light(_DAYLIGHT)
    matrix = camera_to_xyz(camera, daylight, reflectance_spectra())
    white = float(np.percentile(photograph @ matrix[1], _WHITE))
    with without_warnings():
        xy = colour_science().CCS_ILLUMINANTS["CIE 1931 2 Degree Standard Observer"][_DAYLIGHT]

    def convert(rgb: Floats64) -> Floats64:
        with without_warnings():
            xyz = np.maximum(rgb @ matrix.T / white, 0.0)
            return np.asarray(colour_science().XYZ_to_Lab(xyz, xy))

    return convert


def _delta_e(wanted: Floats64, seen: Floats64) -> float:
    with without_warnings():
        return float(colour_science().delta_E(wanted, seen, method="CIE 2000").mean())


def main() -> None:
    """Run what the arguments ask for."""
    parser = argparse.ArgumentParser(prog="python -m tests.evaluation.editing", description=__doc__)
    parser.add_argument("--set", choices=get_args(Split), default="report")
    split: Split = parser.parse_args().set
    settle(own_spectra=True)
    there = pairs(split)
    jobs = [
        (scene, *pair)
        for number, pair in enumerate(PAIRS[split])
        if pair in there
        for scene in scenes_of(number, split)
    ]
    found = []
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        for figures in pool.map(measure, *zip(*jobs, strict=True)):
            found.extend(figures)
            sys.stdout.write("".join(f"{_line(one)}\n" for one in figures))
            sys.stdout.flush()
    sys.stdout.write(f"\n{markdown(summary(found))}\n\n{markdown(by_pair(found))}\n")
    if len(there) < len(PAIRS[split]):
        sys.stdout.write(
            f"\nOnly {len(there)} of {len(PAIRS[split])} pairs of cameras are there, so "
            "docs/editing.md is left as it is: name a copy of rawtoaces-data by "
            "LIGHTLAYERS_SPECTRA.\n"
        )
    elif split == "report":
        _write(found)


def _line(one: Figures) -> str:
    return (
        f"{one.taken} → {one.shown}  {one.scene}  {one.method}  {one.photograph_deg:.2f}°  layers "
        f"{one.layers_deg:.2f}°  ΔE {one.delta_e:.2f}  {one.refusal}".rstrip()
    )


def summary(found: list[Figures]) -> list[list[str]]:
    """A row for each method: mean / worst over all scenes and cameras."""
    rows = [["", "photograph, °", "layers, °", "photograph, ΔE₀₀"]]
    for method in METHODS:
        own = [one for one in found if one.method == method]
        columns = [
            [getattr(one, name) for one in own]
            for name in ("photograph_deg", "layers_deg", "delta_e")
        ]
        cells = [f"{statistics.mean(values):.2f} / {max(values):.2f}" for values in columns]
        rows.append([method, *cells])
    return rows


def by_pair(found: list[Figures]) -> list[list[str]]:
    """A row for each pair of cameras: photograph / layers of each method, mean over its scenes."""
    rows = [["taken by", "shown through", *METHODS]]
    for taken, shown in dict.fromkeys((one.taken, one.shown) for one in found):
        cells = []
        for method in METHODS:
            own = [o for o in found if (o.taken, o.shown, o.method) == (taken, shown, method)]
            photograph = statistics.mean(one.photograph_deg for one in own)
            layers = statistics.mean(one.layers_deg for one in own)
            cells.append(f"{photograph:.2f} / {layers:.2f}")
        rows.append([taken, shown, *cells])
    return rows


def _write(found: list[Figures]) -> None:
    parts = [
        _HEAD.read_text(encoding="utf-8").rstrip(),
        markdown(summary(found)),
        "## Every pair of cameras\n\nMean error in degrees of the photograph / of the layers.",
        markdown(by_pair(found)),
    ]
    (_DOCS / "editing.md").write_text("\n\n".join(parts) + "\n", encoding="utf-8")
    text = json.dumps([_rounded(one) for one in found], indent=1, ensure_ascii=False)
    (_DOCS / "editing.json").write_text(text + "\n", encoding="utf-8")


def _rounded(figures: Figures) -> dict[str, Any]:
    return {n: round(v, 3) if isinstance(v, float) else v for n, v in asdict(figures).items()}


if __name__ == "__main__":
    main()

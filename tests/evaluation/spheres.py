"""How near the lamps that are found from a photographed sphere are to where they stand."""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context

import numpy as np

from pipeline.errors import InputError
from pipeline.vectors import unit
from tests.evaluation.calibrated import CAMERA, calibrate
from tests.evaluation.spectra import Split, lamps, sensitivities
from tests.evaluation.tables import Rows
from tests.targets import CIRCLE, FOCAL_PX, photograph_sphere

_SPHERES = 8


@dataclass(frozen=True)
class SphereFigure:
    """Errors of the lamps' directions from one sphere, None where it was refused."""

    split: Split
    lamps: int
    noise: bool
    error_deg: float | None
    found: int


def measure_sphere(split: Split, count: int, noise: bool, number: int) -> SphereFigure:
    """Find lamps at random places, their number not told, from an outline marked a pixel off."""
    random = np.random.default_rng([number, count, 7 if split == "report" else 2])
    while True:
        directions = unit(random.standard_normal((count, 3)) * [1, 0.8, 0.6] + [0, 0.2, 0.6])
        cosines = directions @ directions.T - 2 * np.eye(count)
        if directions[:, 2].min() > -0.1 and cosines.max() < np.cos(np.radians(30)):
            break
    spectra = lamps(split).spectra[random.choice(len(lamps(split).names), count, replace=False)]
    colours = spectra @ sensitivities(CAMERA).T
    colours *= random.uniform(0.25, 0.5, (count, 1)) / colours[:, 1:2]
    shot = photograph_sphere(directions, colours, float(noise), paint=0.02, seed=number)
    dx, dy, wider = random.normal(0, 1.0, 3)
    circle = {
        "x": CIRCLE["x"] + dx,
        "y": CIRCLE["y"] + dy,
        "radius": CIRCLE["radius"] + wider,
    }
    try:
        found = calibrate("lamps", shot, sphere=circle, focal_px=FOCAL_PX)["light_directions"]
    except InputError:
        return SphereFigure(split, count, noise, None, 0)
    towards = unit(np.array([light["direction"] for light in found]))
    if len(towards) != count:
        return SphereFigure(split, count, noise, None, len(towards))
    angles = np.degrees(np.arccos(np.clip(directions @ towards.T, -1, 1)))
    return SphereFigure(split, count, noise, float(angles.min(axis=1).max()), count)


def measure_spheres(splits: tuple[Split, ...]) -> list[SphereFigure]:
    """Measure on spheres with one to three lamps, with noise and without."""
    jobs = [
        (split, count, noise, number)
        for split in splits
        for count in (1, 2, 3)
        for noise in (False, True)
        for number in range(_SPHERES)
    ]
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        return list(pool.map(measure_sphere, *zip(*jobs, strict=True)))


def sphere_rows(found: list[SphereFigure], split: Split) -> Rows:
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

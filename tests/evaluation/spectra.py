"""Measured lamps, reflectances and cameras from which the pipeline's bases were not learned.

Lamps: the light sources of IES TM-30-15 that were measured (not modelled). Reflectances: Munsell
chips (1269, Joensuu), natural and man-made objects (215, Opstelten 1983) and real samples (210,
CRI2012). All as tabled by luxpy, whose files are read without importing it. Near twins of what the
bases were learned from are left out, so are near twins among themselves: no spectrum of the one
half has a twin in the other.
"""

from __future__ import annotations

import csv
import json
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats64
from pipeline.options import Sensitivities
from pipeline.spectra.bases import SpectralBasis, learn_basis
from pipeline.spectra.colour_science import colour_science, without_warnings
from pipeline.spectra.folder import folder_spectra
from pipeline.spectra.lights import find_light, lamp_spectra, reflectance_spectra
from pipeline.spectra.wavelengths import STEP_NM, WAVELENGTHS_NM, on_grid
from pipeline.vectors import unit

Split = Literal["development", "report"]

CAMERAS = {"Nikon D5100": "Nikon 5100 (NPL)", "Sigma SD1 Merrill": "Sigma SDMerill (NPL)"}
"""Measured cameras: their proper names and colour-science's."""
FLASHES = ("xenon", "led")

_TWIN_COSINE = 0.999
_BROAD_NM = 120.0
_MEASURED = ("Commercial", "Experimental")
_HANDED_OVER: dict[str, Floats64] = {}
_REFLECTANCE_TABLES = ("Munsell1269.dat", "Opstelten1983_215.dat", "CRI2012_R210.dat")


@dataclass(frozen=True)
class Lamps:
    """Lamps of one half. names: n; spectra: (n, W), each summing to 1; broad: bool (n,).

    broad: effective width 5 nm/Σp² of at least 120 nm, as of halogen lamps and white LEDs.
    """

    names: tuple[str, ...]
    spectra: Floats64
    broad: NDArray[np.bool_]


@cache
def lamps(split: Split) -> Lamps:
    """Lamps of a half, by turns of the table, so that both hold every kind."""
    folder = _folder() / "spds"
    with (folder / "IESTM30_15_Sinfo.txt").open(encoding="utf-8") as file:
        rows = [[cell.strip() for cell in row] for row in csv.reader(file)][1:]
    table = _table(folder / "IESTM30_15_Sspds.dat")
    spectra = table / table.sum(axis=1, keepdims=True)
    measured = [i for i, row in enumerate(rows) if row[3] in _MEASURED]
    own = np.array(_without_twins(spectra, measured, lamp_spectra()))[_turn(split) :: 2]
    width_nm = STEP_NM / np.sum(spectra**2, axis=1)
    names = tuple(f"{rows[i][1]} ({rows[i][2]})" for i in own)
    return Lamps(names, _frozen(spectra[own]), width_nm[own] >= _BROAD_NM)


@cache
def reflectances(split: Split) -> Floats64:
    """Reflectances (m, W) of a half, 0 to 1."""
    folder = _folder() / "rfls"
    table = np.concatenate([_table(folder / name) for name in _REFLECTANCE_TABLES])
    own = _without_twins(table, list(range(len(table))), reflectance_spectra())[_turn(split) :: 2]
    return _frozen(table[own])


@cache
def sensitivities(camera: str) -> Floats64:
    """Sensitivities (3, W) of a camera, the largest value 1, ratio of channels as measured.

    camera: one of CAMERAS, one handed over, or an AMPAS JSON in the folder that LIGHTLAYERS_SPECTRA
    names. Read here anew, so that a slip in the pipeline's own reading shows.
    """
    if camera in _HANDED_OVER:
        return _frozen(_HANDED_OVER[camera])
    if camera not in CAMERAS:
        return _ampas(folder_spectra()[camera][0])
    with without_warnings():
        table = colour_science().MSDS_CAMERA_SENSITIVITIES[CAMERAS[camera]]
    values = on_grid(table.wavelengths, table.values, "zero").T
    return _frozen(values / values.max())


def at_hand(camera: str) -> bool:
    """Whether sensitivities knows the camera."""
    return camera in CAMERAS or camera in _HANDED_OVER or camera in folder_spectra()


def hand_over(curves: dict[str, Floats64]) -> None:
    """Tell sensitivities (3, W) by name, to a worker whose pipeline knows no folder of spectra."""
    _HANDED_OVER.update(curves)


def table(camera: str) -> Sensitivities:
    """A camera's table, so that its name cannot mean another measurement."""
    r, g, b = sensitivities(camera).tolist()
    return Sensitivities(wavelength_nm=WAVELENGTHS_NM.tolist(), r=r, g=g, b=b)


def _ampas(path: Path) -> Floats64:
    rows = json.loads(path.read_text(encoding="utf-8"))["spectral_data"]["data"]["main"]
    values = on_grid(
        [float(nm) for nm in rows], [list(map(float, row)) for row in rows.values()], "zero"
    ).T
    return _frozen(values / values.max())


def flash_spectrum(name: str) -> Floats64:
    """Spectrum (W,) of one of FLASHES, summing to 1."""
    return find_light(name)


def axes(camera: str) -> Floats64:
    """(3, 3), camera RGB of a white card under a lamp → the coordinates of coefficients."""
    return _basis(camera).published


@cache
def _basis(camera: str) -> SpectralBasis:
    return learn_basis("wpca", sensitivities(camera), reflectance_spectra(), lamp_spectra())


def coefficients(spectra: Floats64, camera: str) -> Floats64:
    """Coefficients (n, 3) of lamps (n, W), of length one, in an orthonormal weighted-PCA basis.

    These are the coordinates in which Hui et al. 2018 state the angles between their lamps
    (supplement, figures 4 and 9).
    """
    basis = _basis(camera)
    return unit(spectra @ (basis.published @ basis.to_coefficients).T)


def angle_deg(a: Floats64, b: Floats64, camera: str) -> float:
    """Angle between two lamps' coefficient vectors (see coefficients)."""
    u, v = coefficients(np.stack([a, b]), camera)
    across = np.linalg.norm(np.cross(u, v))  # exact where the cosine is near 1
    return float(np.degrees(np.arctan2(across, u @ v)))


def _without_twins(spectra: Floats64, candidates: list[int], known: Floats64) -> list[int]:
    """Candidates unlike every known spectrum and every candidate kept before."""
    unit = spectra / np.linalg.norm(spectra, axis=1, keepdims=True)
    others = known / np.linalg.norm(known, axis=1, keepdims=True)
    kept: list[int] = []
    for i in candidates:
        near = max((others @ unit[i]).max(), (unit[kept] @ unit[i]).max() if kept else 0.0)
        if near <= _TWIN_COSINE:
            kept.append(i)
    return kept


def _turn(split: Split) -> int:
    return {"development": 0, "report": 1}[split]


def _folder() -> Path:
    spec = find_spec("luxpy")
    if spec is None or spec.origin is None:
        raise FileNotFoundError("The evaluation needs the spectra of luxpy: run make setup.")
    return Path(spec.origin).parent / "data"


def _table(path: Path) -> Floats64:
    """Columns of a table whose first one is the wavelength, (n, W)."""
    columns = np.loadtxt(path, delimiter=",")
    return np.clip(on_grid(columns[:, 0], columns[:, 1:], "hold").T, 0.0, None)


def _frozen(values: Floats64) -> Floats64:
    values.setflags(write=False)
    return values

"""What a ColorChecker looks like: where its outer patches are, and what colours it may have."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats64
from pipeline.spectra.colorchecker import COLUMNS, ROWS, colorchecker_spectra
from pipeline.spectra.observer import cie_1931

_TURNS = 10  # of finding the matrix and how bright patches are

CORNER_NAMES = ("dark skin", "bluish green", "black", "white")
"""The outer patches, clockwise."""

CORNERS = np.array([(0, 0), (COLUMNS - 1, 0), (COLUMNS - 1, ROWS - 1), (0, ROWS - 1)], np.float64)
"""Their places (4, 2), column and row."""

PLACES = np.array([(c, r) for r in range(ROWS) for c in range(COLUMNS)], np.float64)
"""Places (24, 2) of all patches, column and row, in their order."""


def colour_misfit(light: Floats64, patches: NDArray[np.intp] | None = None) -> float:
    """Relative error that the best matrix from the patches' XYZ to their light (n, 3) leaves.

    patches: (n,) which of the 24 they are, row by row from 0; None for all, in their order. Light
    of one colour on them leaves a few hundredths.
    """
    xyz = colorchecker_spectra() @ cie_1931().T
    if patches is not None:
        xyz = xyz[patches]
    weight = 1 / np.maximum(light.sum(axis=1, keepdims=True), 1e-12)
    left = light - xyz @ np.linalg.lstsq(xyz * weight, light * weight, rcond=None)[0]
    return float(np.sqrt(np.mean(np.square(left * weight)) / np.mean(np.square(light * weight))))


def tint_misfit(light: Floats64) -> float:
    """Error that the best matrix from XYZ leaves of the 24 patches' tints, by their spread.

    light: (24, 3), in their order, each as bright as it may be: an uneven flash changes nothing.
    Of a chart three tenths at most, and more than four of one that lies otherwise.
    """
    tints = light / np.maximum(light.sum(axis=1, keepdims=True), 1e-12)
    xyz = colorchecker_spectra() @ cie_1931().T
    xyz /= xyz.sum(axis=1, keepdims=True)
    bright = np.ones((len(xyz), 1))
    for _ in range(_TURNS):
        seen = xyz @ np.linalg.lstsq(xyz * bright, tints, rcond=None)[0]
        bright = (seen * tints).sum(axis=1, keepdims=True) / np.square(seen).sum(
            axis=1, keepdims=True
        )
    spread = np.square(tints - tints.mean(axis=0)).sum()
    return float(np.sqrt(np.square(tints - bright * seen).sum() / np.maximum(spread, 1e-12)))

"""The methods that are compared, all on the files that a photographer would send."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

import numpy as np

from pipeline.arrays import Floats32, Floats64
from pipeline.images.frames import Matrix
from pipeline.images.push_pull import push_pull
from tests.definitions.pixels import normalised
from tests.evaluation.baselines.equal_split import equal_split
from tests.evaluation.baselines.nnmf import nnmf
from tests.evaluation.baselines.von_kries import von_kries_matrices
from tests.evaluation.ceilings import (
    best_matrices,
    proportions,
    regressed_matrices,
    tuned_matrices,
)
from tests.evaluation.product import run_product
from tests.evaluation.shots import Shot
from tests.layers import layers_of

Layers = Floats32


@dataclass(frozen=True)
class Answer:
    """What a method says of a pair.

    layers: (N, H, W, 3) on the scale of the no-flash photograph. coefficients: (N, 3) of
    the lamps, None where the method does not tell. confidence: 0…1 that the
    number of lamps is right. warnings: of the manifest. of_white: the coefficients are the camera
    RGB of a white card under each lamp, not coordinates in the basis of lights.
    """

    layers: Layers
    coefficients: Floats64 | None = None
    confidence: float | None = None
    warnings: tuple[dict[str, Any], ...] = ()
    of_white: bool = False


def _product(
    shot: Shot, method: Literal["best", "paper"], basis: Literal["wpca", "pca", "joint"] = "wpca"
) -> Answer:
    """Run the whole way of the service, from files to files. Raises InputError as it does."""
    manifest, planes = run_product(shot, "layers.exr", method=method, basis=basis)
    return Answer(
        layers_of(planes, len(manifest["lamps"])),
        np.array([lamp["coefficients"] for lamp in manifest["lamps"]]),
        manifest["lights"]["confidence"],
        tuple(manifest["warnings"]),
        of_white=method == "best",  # its matrices need no basis
    )


def _paper_shared(shot: Shot) -> Answer:
    """The published layers' proportions, dealt out over the photograph."""
    answer = _product(shot, "paper")
    parts = np.maximum(answer.layers, 0.0)
    return Answer(normalised(parts) * shot.photograph, answer.coefficients)


def _von_kries(shot: Shot) -> Answer:
    reduced = shot.reduced
    no_flash, flash = (
        image[reduced.usable].astype(np.float64) for image in (reduced.no_flash, reduced.flash)
    )
    matrices = von_kries_matrices(no_flash, flash, shot.count)
    return _answer(shot, matrices)


def _known(shot: Shot) -> Answer:
    matrices = regressed_matrices(shot.sensitivities, shot.flash_spectrum, shot.lamp_spectra)
    return _answer(shot, matrices)


def _best_3x3(shot: Shot) -> Answer:
    return _answer(shot, _best_matrices(shot))


def _tuned_3x3(shot: Shot) -> Answer:
    start = _best_matrices(shot)
    seen = (shot.photograph, *shot.filtered)
    return _answer(shot, tuned_matrices(shot.truth, *seen, shot.valid & shot.usable, start))


def _best_matrices(shot: Shot) -> Matrix:
    truth, seen = (shot.truth, shot.flash_part), (shot.photograph, *shot.filtered)
    return best_matrices(*truth, *seen, shot.valid & shot.usable)


def _answer(shot: Shot, matrices: Matrix) -> Answer:
    """The photograph in the proportions of known lamps, or of the surroundings where need be."""
    parts = proportions(*shot.filtered, matrices)
    count, height, width, channels = parts.shape
    planes = np.moveaxis(parts, 0, 2).reshape(height, width, count * channels)
    filled = push_pull(planes, shot.usable.astype(np.float32)).reshape(height, width, count, -1)
    return Answer(np.moveaxis(filled, 2, 0) * shot.photograph)


METHODS: dict[str, Callable[[Shot], Answer]] = {
    "equal": lambda shot: Answer(equal_split(shot.photograph, shot.count)),
    "nnmf": lambda shot: Answer(nnmf(shot.photograph, shot.count)),
    "von_kries": _von_kries,
    "paper_pca": partial(_product, method="paper", basis="pca"),
    "paper_joint": partial(_product, method="paper", basis="joint"),
    "paper": partial(_product, method="paper"),
    "paper_shared": _paper_shared,
    "best": partial(_product, method="best"),
    "known": _known,
    "best_3x3": _best_3x3,
    "tuned_3x3": _tuned_3x3,
}
"""In the order of the tables."""

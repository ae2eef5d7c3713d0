"""All pictures of a run, computed in one pass over the strips."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.frames import Image
from pipeline.hui2018.white_balance import PublishedWhiteBalance
from pipeline.lamps import Lamps
from pipeline.mesh import Mesh, make_mesh
from pipeline.model import Model
from pipeline.normals import Facing
from pipeline.pair import Pair
from pipeline.photometric_stereo.confidence import normals_confidence
from pipeline.photometric_stereo.detail import surface_depth
from pipeline.progress import Progress
from pipeline.reduced import ReducedPair
from pipeline.response import camera_changes, other_response
from pipeline.separation import separate
from pipeline.white_balance import WhiteBalance

_FILLED = 0.5  # confidence below which a pixel counts as filled in


@dataclass(frozen=True)
class Pictures:
    """Linear pictures (H, W, 3); None where not wanted.

    photograph: the no-flash photograph. layers: (N, H, W, 3). white_balanced_1, _2: camera RGB as
    under the neutral light, by approach I and II. normals: unit, NaN where unknown. depth: (H, W),
    relative, NaN where unknown. mesh: the same as triangles. normals_confidence: (H, W) 0…1, how
    far the normals can be trusted. response: the photograph in linear RGB of the other camera.
    camera_changes: (N, 3, 3), layers → the other camera's RGB. confidence: (H, W) 0…1, 0 where
    the layers are filled in from their surroundings. filled: share of pixels filled in, 0…1.
    separated: (N,) part 0…1 of each lamp's light that was separated and not filled in, Σ confidence
    · layer ÷ Σ layer.
    """

    photograph: Image
    layers: NDArray[np.float32]
    white_balanced_1: Image | None
    white_balanced_2: Image | None
    normals: Image | None
    normals_confidence: NDArray[np.float32] | None
    depth: NDArray[np.float32] | None
    mesh: Mesh | None
    response: Image | None
    camera_changes: NDArray[np.float64] | None
    confidence: NDArray[np.float32] | None
    filled: float
    separated: NDArray[np.float64]


def render(
    pair: Pair,
    reduced: ReducedPair,
    lamps: Lamps,
    model: Model,
    facing: Facing | None,
    method: str,
    wanted: frozenset[str],
    progress: Progress,
    strip_rows: int,
) -> Pictures:
    """Separate the pair and make every picture that a wanted output needs.

    wanted: names of outputs (pipeline.options.OUTPUT_NAMES).
    """
    shape = pair.no_flash.shape

    def canvas(*outputs: str) -> Image | None:
        return np.empty(shape, dtype=np.float32) if wanted & set(outputs) else None

    layers = np.empty((len(lamps), *shape), dtype=np.float32)
    surface = None if facing is None else facing.surface
    meshed = surface is not None and "surface.glb" in wanted
    balanced_1 = canvas(
        "white_balanced_1.jpg",
        "white_balanced_1.tif",
        "white_balanced.exr",
        *(["surface.glb"] if meshed else []),
    )
    balanced_2 = canvas("white_balanced_2.jpg", "white_balanced_2.tif", "white_balanced.exr")
    normals = (
        canvas("normals.png", "normals.exr", "normals_confidence.tif", "surface.glb")
        if facing
        else None
    )
    response, changes = None, None
    if model.response is not None:
        response = canvas("response.jpg", "response_lamps.jpg", "response.exr")
        changes = camera_changes(lamps, model, model.response, method)
    confidence = np.empty(shape[:2], dtype=np.float32) if "confidence.tif" in wanted else None
    trust, depth = None, None
    if surface is not None and "normals_confidence.tif" in wanted:
        trust = np.empty(shape[:2], dtype=np.float32)
    if surface is not None and wanted & {"depth.exr", "surface.glb"}:
        depth = surface_depth(surface, shape[:2])
    balance = (WhiteBalance if method == "best" else PublishedWhiteBalance)(lamps, model)
    filled = 0
    light, sure = np.zeros((2, len(lamps), shape[0]))  # of each row, so that strips do not matter
    for strip in separate(pair, reduced, lamps, model, method, progress, strip_rows, layers):
        rows = strip.rows
        filled += _add_up(strip.layers, strip.confidence, light[:, rows], sure[:, rows])
        if confidence is not None:
            confidence[rows] = strip.confidence
        if balanced_1 is not None:
            balance.approach_1(strip, balanced_1[rows])
        if balanced_2 is not None:
            balance.approach_2(strip, balanced_2[rows])
        if normals is not None and facing is not None:
            normals[rows] = facing.of(strip)
            if trust is not None and surface is not None:
                trust[rows] = normals_confidence(strip, surface, normals[rows])
        if response is not None and changes is not None:
            response[rows] = other_response(strip, changes)
    mesh = None
    if meshed and surface is not None and depth is not None and normals is not None:
        mesh = make_mesh(depth, normals, surface.focal_px)
    return Pictures(
        photograph=pair.no_flash,
        layers=layers,
        white_balanced_1=balanced_1,
        white_balanced_2=balanced_2,
        normals=normals,
        normals_confidence=trust,
        depth=depth,
        mesh=mesh,
        response=response,
        camera_changes=changes,
        confidence=confidence,
        filled=filled / (shape[0] * shape[1]),
        separated=sure.sum(axis=1) / np.maximum(light.sum(axis=1), 1e-12),
    )


@njit(cache=True)
def _add_up(
    layers: NDArray[np.float32],
    confidence: NDArray[np.float32],
    light: NDArray[np.float64],
    sure: NDArray[np.float64],
) -> int:
    """Write the light of each row (N, h), and what of it is sure; return how many are filled."""
    filled = 0
    for y in range(confidence.shape[0]):
        for j in range(len(layers)):
            light[j, y] = sure[j, y] = 0.0
            for x in range(confidence.shape[1]):
                total = 0.0
                for k in range(3):
                    total += max(np.float64(layers[j, y, x, k]), 0.0)
                light[j, y] += total
                sure[j, y] += total * confidence[y, x]
        for x in range(confidence.shape[1]):
            filled += confidence[y, x] < _FILLED
    return filled

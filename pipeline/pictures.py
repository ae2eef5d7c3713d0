"""All pictures of a run, computed in one pass over the strips."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Image
from pipeline.lamps import Lamps
from pipeline.model import Model
from pipeline.normals import Facing
from pipeline.pair import Pair
from pipeline.photometric_stereo.detail import surface_depth
from pipeline.progress import Progress
from pipeline.reduced import ReducedPair
from pipeline.response import other_response
from pipeline.separation import separate
from pipeline.white_balance import approach_1, approach_2

_FILLED = 0.5  # confidence below which a pixel counts as filled in


@dataclass(frozen=True)
class Pictures:
    """Linear pictures (H, W, 3); None where not wanted.

    photograph: the no-flash photograph. layers: (N, H, W, 3). white_balanced_1, _2: camera RGB as
    under the neutral light, by approach I and II. normals: unit, NaN where unknown. depth: (H, W),
    relative, NaN where unknown. response: RGB of the other camera. confidence: (H, W) 0…1, 0 where
    the layers are filled in from their surroundings. filled: share of pixels filled in, 0…1.
    separated: (N,) part 0…1 of each lamp's light that was separated and not filled in, Σ confidence
    · layer ÷ Σ layer.
    """

    photograph: Image
    layers: NDArray[np.float32]
    white_balanced_1: Image | None
    white_balanced_2: Image | None
    normals: Image | None
    depth: NDArray[np.float32] | None
    response: Image | None
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
    balanced_1 = canvas("white_balanced_1.jpg", "white_balanced_1.tif", "white_balanced.exr")
    balanced_2 = canvas("white_balanced_2.jpg", "white_balanced_2.tif", "white_balanced.exr")
    normals = canvas("normals.png", "normals.exr") if facing else None
    response = canvas("response.jpg") if model.response else None
    confidence = np.empty(shape[:2], dtype=np.float32) if "confidence.tif" in wanted else None
    depth = None
    if facing is not None and facing.surface is not None and "depth.exr" in wanted:
        depth = surface_depth(facing.surface, shape[:2])
    filled = 0
    light, sure = np.zeros((2, len(lamps), shape[0]))  # of each row, so that strips do not matter
    for strip in separate(pair, reduced, lamps, model, method, progress, strip_rows):
        rows = strip.rows
        layers[:, rows] = strip.layers
        filled += int((strip.confidence < _FILLED).sum())
        row_light = np.maximum(strip.layers, 0.0).sum(axis=3, dtype=np.float64)
        light[:, rows] = row_light.sum(axis=2)
        sure[:, rows] = (row_light * strip.confidence).sum(axis=2)
        if confidence is not None:
            confidence[rows] = strip.confidence
        if balanced_1 is not None:
            balanced_1[rows] = approach_1(strip, lamps, model, method)
        if balanced_2 is not None:
            balanced_2[rows] = approach_2(strip, lamps, model, method)
        if normals is not None and facing is not None:
            normals[rows] = facing.of(strip)
        if response is not None and model.response is not None:
            response[rows] = other_response(strip, lamps, model.response)
    return Pictures(
        photograph=pair.no_flash,
        layers=layers,
        white_balanced_1=balanced_1,
        white_balanced_2=balanced_2,
        normals=normals,
        depth=depth,
        response=response,
        confidence=confidence,
        filled=filled / (shape[0] * shape[1]),
        separated=sure.sum(axis=1) / np.maximum(light.sum(axis=1), 1e-12),
    )

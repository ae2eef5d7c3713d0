"""The per-pixel work beside a copy of the same bytes, its definition, and the plain way.

The plain way makes the same pictures from coefficients that numpy.linalg.solve finds.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from pipeline.images.frames import by_planes, channels_first, planes_of, rows_by_planes
from pipeline.images.strips import STRIP_ROWS
from pipeline.lamps.lamps import Lamps
from pipeline.light.model import Model, build_model
from pipeline.matrixfit.deviations import no_deviations
from pipeline.pictures.white_balance import WhiteBalance, whites_of
from pipeline.separation import separation
from pipeline.separation.proportions import model_proportions, predictions
from pipeline.separation.separation import Strip
from pipeline.spectra.cameras import Camera, measured_cameras
from pipeline.spectra.lights import find_light
from tests.bench.usage import cpu_of
from tests.definitions import pixels

_WIDTH, _STRIPS = 4000, 16
_ROUNDS = 5
_LAMPS = ("A", "D150")


def measure() -> dict[str, float]:
    """Ratios of CPU time on two megapixels, two lamps: `memcpy_ratio` and so on."""
    model = _model()
    lamps = _lamps(model)
    balance = WhiteBalance(lamps, model, 1.0)
    rng = np.random.default_rng(1)
    flash = rng.uniform(0.01, 1, (_STRIPS, STRIP_ROWS, _WIDTH, 3)).astype(np.float32)
    shares = rng.uniform(0.05, 0.5, (2, _STRIPS, STRIP_ROWS, _WIDTH, 1)).astype(np.float32)
    lit = np.stack([predictions(strip, lamps) for strip in flash], axis=1)
    photograph = np.asarray((shares * lit).sum(axis=0), dtype=np.float32)
    layers = np.empty((2, *photograph.shape), np.float32)
    balanced = np.empty((2, *photograph.shape), np.float32)
    sure = np.ones((STRIP_ROWS, _WIDTH), np.float32)

    def strips() -> Any:
        return zip(range(_STRIPS), photograph, flash, strict=True)

    def compiled() -> None:
        for _, given, added in strips():
            rows = slice(0, STRIP_ROWS)
            seen, part = rows_by_planes(given, rows), rows_by_planes(added, rows)
            parts = model_proportions(seen, part, lamps)
            lit = by_planes(2, *given.shape)
            separation._deal_out(planes_of(seen), sure, channels_first(parts), channels_first(lit))
            balance.of(Strip(rows, lit, seen, part, sure), True, True)

    def defined() -> None:
        matrix = model.flash_to_neutral
        greens = whites_of(lamps, model)[:, 1] / (matrix @ model.flash_white)[1]
        for i, seen, part in strips():
            layers[:, i] = pixels.model_proportions(seen, part, lamps) * seen
            strip = Strip(slice(0, STRIP_ROWS), layers[:, i], seen, part, sure)
            balanced[0, i] = pixels.approach_1(strip, lamps, greens, matrix)
            balanced[1, i] = pixels.approach_2(strip, model, matrix)

    def solved() -> None:
        matrix, brightness = model.flash_to_neutral, whites_of(lamps, model)[:, 1]
        to_shares = np.linalg.pinv(lamps.coefficients.T)
        columns = np.stack([flash @ d.T for d in np.moveaxis(model.tensor, 2, 0)], axis=-1)
        beta = np.linalg.solve(columns, photograph[..., None])[..., 0]
        z = np.maximum(beta @ to_shares.T, 0)
        layers[...] = predictions(flash, lamps) * np.moveaxis(z, -1, 0)[..., None]
        neutral = flash @ matrix.T
        balanced[0] = (z @ brightness)[..., None] * neutral
        balanced[1] = np.linalg.norm(beta, axis=-1, keepdims=True) * neutral

    reads = np.empty_like(photograph), np.empty_like(photograph)
    writes = np.empty_like(layers), np.empty_like(layers)

    def copied() -> None:
        # half of the bytes that are read and written: a copy does both
        np.copyto(reads[0], photograph)
        np.copyto(writes[0], layers)

    calls = {"compiled": compiled, "defined": defined, "solved": solved, "copied": copied}
    seconds = cpu_of(calls, _ROUNDS)
    return {
        "memcpy_ratio": seconds["compiled"] / seconds["copied"],
        "numpy_speedup": seconds["defined"] / seconds["compiled"],
        "solve_speedup": seconds["solved"] / seconds["compiled"],
    }


def _model() -> Model:
    camera: Camera = next(one for one in measured_cameras() if one.name == "Nikon D5100")
    return build_model(camera, find_light("xenon"), find_light("D65"), "wpca")


def _lamps(model: Model) -> Lamps:
    seen = np.stack([model.camera.sensitivities @ find_light(name) for name in _LAMPS])
    coefficients = seen / np.linalg.norm(seen, axis=1, keepdims=True)
    count = len(coefficients)
    return Lamps(
        coefficients=coefficients,
        matrices=model.lamp_matrix(coefficients),
        deviations=no_deviations(count),
        channel_weights=np.ones(3),
        requested=2,
        confidence=1.0,
        lamp_confidence=np.ones(count),
        pinned=np.full(count, -1),
        invariants=coefficients,
        four_or_more=False,
        left_over=0.0,
        alone=np.full(count, 0.01),
        contradictions=(),
    )

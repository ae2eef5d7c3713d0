"""A run of 40 × 64 pixels whose pictures are given, and its outputs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.estimate import Estimate
from pipeline.light.model import Model
from pipeline.pair.reduced import ReducedPair, reduce_pair
from pipeline.photometric_stereo.facing import Facing
from pipeline.progress import Progress
from pipeline.results.outputs import Outputs
from pipeline.results.pictures import Pictures
from tests.surfaces import wall

ENTRIES: list[dict[str, Any]] = [
    {"name": "lamp1", "cct_k": 2850, "family": "incandescent", "family_confidence": 0.934},
    {"name": "lamp2", "cct_k": None, "family": "RGB LED", "family_confidence": 0.4},
]
SIZE = (40, 64)


@pytest.fixture
def pictures() -> Pictures:
    """Pictures of 40 × 64 pixels: two layers, everything else as well."""
    rng = np.random.default_rng(3)
    layers, balanced = (rng.uniform(0, 0.4, (2, *SIZE, 3)).astype(np.float32) for _ in range(2))
    normals = np.zeros((*SIZE, 3), np.float32)
    normals[..., 2] = 1
    normals[:5] = np.nan
    return Pictures(
        rows=slice(0, SIZE[0]),
        layers=layers,
        shown_layers=layers,
        white_balanced_1=balanced[0],
        white_balanced_2=balanced[1],
        normals=normals,
        normals_confidence=np.full(SIZE, 0.5, np.float32),
        response=None,
        confidence=np.linspace(0, 1, 40 * 64, dtype=np.float32).reshape(SIZE),
    )


@pytest.fixture
def facing() -> Facing:
    """A wall, at depth 1.25, known below the fifth row."""
    return wall(np.arange(SIZE[0])[:, None] >= np.full(SIZE, 5), 1.25, 2)


@pytest.fixture
def reduced(exact: Callable[..., tuple[Any, Floats64]], warm_to_cool: Floats64) -> ReducedPair:
    """A reduced pair of 96 × 64 pixels with two lamps."""
    return reduce_pair(exact(warm_to_cool[[0, 2]])[0])


@pytest.fixture
def written(
    pictures: Pictures,
    facing: Facing,
    reduced: ReducedPair,
    model: Model,
    lamps_of: Callable[..., Any],
    warm_to_cool: Floats64,
    tmp_path: Path,
) -> Callable[..., list[dict[str, Any]]]:
    """Write outputs into a folder, 16 rows at a time; returns what is said of them."""

    def run(*wanted: str, **more: Any) -> list[dict[str, Any]]:
        given = more.get("given", pictures)
        estimate = Estimate(
            reduced,
            more.get("by", model),
            lamps_of(warm_to_cool[[0, 2]]),
            more.get("facing", facing),
            more.get("changes"),
        )
        with Outputs(
            more.get("photograph", given.layers.sum(axis=0)),
            more.get("clipping", np.inf),
            given,
            estimate,
            frozenset(wanted),
            tmp_path,
            more.get("convention", "gl"),
        ) as opened:
            for top in range(0, SIZE[0], 16):
                opened.add(some_rows(given, slice(top, min(top + 16, SIZE[0]))))
            return opened.finish(ENTRIES, more.get("progress", Progress()))

    return run


def some_rows(pictures: Pictures, rows: slice) -> Pictures:
    cut: Any = {
        field.name: None if (whole := getattr(pictures, field.name)) is None else whole[rows]
        for field in fields(pictures)
        if field.name not in ("rows", "layers", "shown_layers")
    }
    layers, shown = pictures.layers[:, rows], pictures.shown_layers[:, rows]
    return Pictures(rows=rows, layers=layers, shown_layers=shown, **cut)

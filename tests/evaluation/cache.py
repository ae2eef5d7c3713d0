"""Rendered transports, kept between runs."""

from __future__ import annotations

import hashlib
import os
import tempfile
import zipfile
from importlib.metadata import version
from pathlib import Path

import numpy as np

from pipeline.arrays import Floats64
from tests.evaluation import render
from tests.evaluation.geometry import Geometry
from tests.evaluation.transport import Transport, from_arrays


def folder() -> Path:
    """Where transports are kept: lightlayers/evaluation in $XDG_CACHE_HOME, else in ~/.cache."""
    base = os.environ.get("XDG_CACHE_HOME")
    root = Path(base) if base else Path.home() / ".cache"
    return root / "lightlayers" / "evaluation"


def transport(geometry: Geometry, palette: Floats64, size: tuple[int, int]) -> Transport:
    """As render.render, from the cache where it is there.

    What is rendered passes through the same half floats as what is read, so that the first run
    and later ones agree to the last bit.
    """
    path = folder() / f"{_key(geometry, palette, size)}.npz"
    try:
        with path.open("rb") as kept, np.load(kept) as arrays:
            return from_arrays(dict(arrays))
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):  # missing or cut short
        arrays = render.render(geometry, palette, size).arrays()
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.NamedTemporaryFile(dir=path.parent, suffix=".tmp", delete=False) as file:
        np.savez_compressed(file, allow_pickle=False, **arrays)
    Path(file.name).replace(path)  # whole or not at all, also when two runs write at once
    return from_arrays(arrays)


def _key(geometry: Geometry, palette: Floats64, size: tuple[int, int]) -> str:
    digest = hashlib.sha256(repr((render.VERSION, version("mitsuba"), geometry, size)).encode())
    if geometry.depth != 2:  # direct light does not depend on the colours
        digest.update(np.ascontiguousarray(palette).tobytes())
    return digest.hexdigest()[:32]

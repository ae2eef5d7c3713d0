"""Small pairs as files, separated by separate_files."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from PIL import Image as PillowImage

from pipeline.arrays import Floats
from pipeline.colour.curves import linear_to_srgb
from pipeline.options import DirectedLight, Options
from pipeline.process import separate_files
from pipeline.progress import Progress

Files = tuple[bytes, bytes]
CAMERA: dict[str, Any] = {"camera": "Nikon D5100", "exposure_ratio": 1.0, "align": False}
DIRECTIONS = [DirectedLight(direction=d) for d in ((0.6, 0.2, 1), (-0.5, 0.5, 1), (0.1, -0.7, 1))]


def tiff(values: Floats, camera: tuple[str, str] | None = None) -> bytes:
    """A float TIFF, read as linear. camera: the make and model that it names."""
    file = io.BytesIO()
    tags = [(271 + i, 2, 0, name, True) for i, name in enumerate(camera or ())]
    data = values.astype(np.float32)
    tifffile.imwrite(file, data, photometric="rgb", metadata=None, extratags=tags)
    return file.getvalue()


def turned(file: bytes, orientation: int) -> bytes:
    """The same TIFF, which says an EXIF orientation."""
    values, copy = tifffile.imread(io.BytesIO(file)), io.BytesIO()
    tags = [(274, "H", 1, orientation, True)]
    tifffile.imwrite(copy, values, photometric="rgb", metadata=None, extratags=tags)
    return copy.getvalue()


def png(values: Floats) -> bytes:
    """An 8-bit PNG, read as sRGB."""
    file = io.BytesIO()
    codes = np.round(255 * linear_to_srgb(np.clip(values.astype(np.float64), 0, 1)))
    PillowImage.fromarray(codes.astype(np.uint8)).save(file, "PNG")
    return file.getvalue()


def separated(
    files: Files, folder: Path, progress: Progress | None = None, rows: int = 256, **options: Any
) -> dict[str, Any]:
    given = Options(**{**CAMERA, **options})
    return separate_files(*files, given, folder, progress or Progress(), rows)


def codes(manifest: dict[str, Any]) -> list[str]:
    return [warning["code"] for warning in manifest["warnings"]]

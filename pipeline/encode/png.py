from __future__ import annotations

from pathlib import Path

import imagecodecs
import numpy as np
from numpy.typing import NDArray
from PIL import Image as PillowImage

from pipeline.frames import Image
from pipeline.progress import STRIP_ROWS

_ZLIB_LEVEL = 3
"""Level 6 takes twice the time for a hundredth of the size."""


def write_png8(path: Path, codes: NDArray[np.uint8]) -> None:
    """Write 8-bit code values (H, W, 3) as they are. Raises OSError."""
    PillowImage.fromarray(codes).save(path, "PNG")


def write_normals_png(path: Path, normals: Image) -> None:
    """Write unit normals (H, W, 3) as a 16-bit normal map; raises OSError.

    OpenGL convention: x right, y up, z to the viewer; code = (n + 1)/2 · 65535. Pixels without a
    normal (not finite, or of no length) are 0, 0, 0, which no unit normal gives.
    """
    codes = np.empty(normals.shape, dtype=np.uint16)
    for top in range(0, normals.shape[0], STRIP_ROWS):
        strip = normals[top : top + STRIP_ROWS]
        known = np.isfinite(strip).all(axis=2, keepdims=True) & strip.any(axis=2, keepdims=True)
        scaled = np.clip((np.where(known, strip, -1.0) + 1.0) / 2.0, 0.0, 1.0) * 65535
        codes[top : top + STRIP_ROWS] = np.round(scaled)
    path.write_bytes(imagecodecs.png_encode(codes, level=_ZLIB_LEVEL))

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import tifffile
from numpy.typing import NDArray

from pipeline.colour.icc import linear_rec2020_profile
from pipeline.frames import Image, Matrix
from pipeline.progress import STRIP_ROWS

_IDENTITY: Matrix = np.eye(3)


def write_gray_tiff(path: Path, plane: NDArray[np.float32]) -> None:
    """Write a plane (H, W), 0 to 1, as 16-bit linear grey; raises OSError."""
    height, width = plane.shape
    strips = (
        np.round(np.clip(plane[top : top + STRIP_ROWS], 0.0, 1.0) * 65535).astype(np.uint16)
        for top in range(0, height, STRIP_ROWS)
    )
    with tifffile.TiffWriter(path) as file:
        file.write(
            strips,
            shape=(height, width),
            dtype=np.uint16,
            photometric="minisblack",
            rowsperstrip=STRIP_ROWS,
            software=False,
            metadata=None,
        )


def write_tiff(path: Path, linear: Image, to_rec2020: Matrix = _IDENTITY) -> None:
    """Write (H, W, 3) as 16-bit linear Rec. 2020 with its ICC profile.

    linear: linear values, 1.0 = white; to_rec2020: matrix (3, 3) that takes a pixel to linear
    Rec. 2020. What lies outside 0 to 1 is cut off. The values stay linear so that in an editor
    the layers add up to the photograph by "Linear Dodge (Add)"; the wide primaries hold what
    lamps shine. Uncompressed: deflating noisy 16-bit values takes thirty times as long and saves
    little. Raises OSError where the file cannot be written.
    """
    height, width = linear.shape[:2]

    def strips() -> Iterator[NDArray[np.uint16]]:
        matrix = np.asarray(to_rec2020.T, dtype=np.float32)
        for top in range(0, height, STRIP_ROWS):
            strip = np.clip(linear[top : top + STRIP_ROWS] @ matrix, 0.0, 1.0)
            yield np.round(strip * 65535).astype(np.uint16)

    with tifffile.TiffWriter(path) as file:
        file.write(
            strips(),
            shape=(height, width, 3),
            dtype=np.uint16,
            photometric="rgb",
            rowsperstrip=STRIP_ROWS,
            iccprofile=linear_rec2020_profile(),
            software=False,
            metadata=None,
        )

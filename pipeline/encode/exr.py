from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenEXR
from numpy.typing import NDArray


def write_exr(path: Path, channels: dict[str, NDArray[np.float32]], half: bool = False) -> None:
    """Write named planes, each (H, W), as scan lines with lossless ZIP compression.

    half: store 16-bit floats, which end at 65504 and keep 11 bits; else 32-bit floats.
    Raises ValueError for planes of different size, OSError where the file cannot be written.
    """
    if len({plane.shape for plane in channels.values()}) != 1:
        raise ValueError("the channels of an EXR must have one size")
    kind = np.float16 if half else np.float32
    planes = {
        name: np.ascontiguousarray(plane, dtype=kind) for name, plane in sorted(channels.items())
    }
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    try:
        OpenEXR.File(header, planes).write(str(path))
    except RuntimeError as error:  # OpenEXR's only word for a full or missing disk
        raise OSError(str(error)) from error

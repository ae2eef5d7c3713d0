from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenEXR
from numpy.typing import NDArray


def write_exr(path: Path, pictures: dict[str, NDArray[np.float32]], half: bool = False) -> None:
    """Write pictures as uncompressed scan lines: docs/decisions/0011-uncompressed-layers.md.

    pictures: planes (H, W), each the channel of its name, and pictures (H, W, 3), the channels
    name.R, name.G and name.B, or R, G and B if the name is RGB.
    half: store 16-bit floats, which end at 65504 and keep 11 bits; else 32-bit floats.
    Raises ValueError for pictures of different size, OSError where the file cannot be written.
    """
    if len({picture.shape[:2] for picture in pictures.values()}) != 1:
        raise ValueError("the channels of an EXR must have one size")
    kind = np.float16 if half else np.float32
    channels = {  # OpenEXR reads memory as it lies, whatever the strides
        name: np.ascontiguousarray(picture, dtype=kind) for name, picture in pictures.items()
    }
    header = {"compression": OpenEXR.NO_COMPRESSION, "type": OpenEXR.scanlineimage}
    try:
        OpenEXR.File(header, channels).write(str(path))
    except RuntimeError as error:  # OpenEXR's only word for a full or missing disk
        raise OSError(str(error)) from error

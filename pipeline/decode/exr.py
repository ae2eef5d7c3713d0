"""OpenEXR: linear half and float."""

from __future__ import annotations

import io

import numpy as np
import OpenEXR

from pipeline.decode.quiet import muted
from pipeline.decode.samples import Samples


def exr_size(data: bytes) -> tuple[int, int]:
    """(width, height) of the data window of the first part. Raises what OpenEXR raises."""
    with muted():
        header = OpenEXR.File(io.BytesIO(data), header_only=True).header()
    (left, top), (right, bottom) = header["dataWindow"]
    return int(right) - int(left) + 1, int(bottom) - int(top) + 1


def read_exr(data: bytes) -> Samples:
    """Read R, G, B, or Y, of the first part. Raises ValueError and what OpenEXR raises."""
    with muted():
        channels = OpenEXR.File(io.BytesIO(data), separate_channels=True).channels()
    names = ("R", "G", "B") if "R" in channels else ("Y", "Y", "Y")
    planes = [channels[name].pixels for name in names]
    if any(plane.dtype.kind != "f" or plane.shape != planes[0].shape for plane in planes):
        raise ValueError("no float channels of one size")
    return Samples(np.stack(planes, axis=-1).astype(np.float32, copy=False), 1.0)

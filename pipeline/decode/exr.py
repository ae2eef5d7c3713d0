"""OpenEXR: linear half and float."""

from __future__ import annotations

import io

import numpy as np
import OpenEXR

from pipeline.data_window import size_of_window
from pipeline.decode.quiet import muted
from pipeline.decode.samples import Samples, UnsuitableError


def exr_size(data: bytes) -> tuple[int, int]:
    """(width, height) of the data window of the first part. Raises what OpenEXR raises."""
    header = OpenEXR.File(io.BytesIO(data), header_only=True).header()
    return size_of_window(*header["dataWindow"])


def read_exr(data: bytes) -> Samples:
    """Read R, G and B of the first part.

    Raises UnsuitableError without colours or with integers, ValueError and what OpenEXR raises.
    """
    with muted():
        channels = OpenEXR.File(io.BytesIO(data), separate_channels=True).channels()
    if not {"R", "G", "B"} <= channels.keys():
        raise UnsuitableError("is an EXR without channels R, G and B: save it with those.")
    planes = [channels[name].pixels for name in "RGB"]
    if any(plane.dtype.kind != "f" for plane in planes):
        raise UnsuitableError("is an EXR of integers: save it with half or float channels.")
    return Samples(np.stack(planes, axis=-1).astype(np.float32, copy=False), 1.0)

"""OpenEXR: linear half and float."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import OpenEXR

from pipeline.decode.profiles import profile_of_chromaticities
from pipeline.decode.quiet import muted
from pipeline.decode.samples import Samples, UnsuitableError, refuse_premultiplied
from pipeline.images.data_window import size_of_window

_COLOURS = ("R", "G", "B")
_EXIF_NAMES = {
    "expTime": "EXIF ExposureTime",
    "isoSpeed": "EXIF PhotographicSensitivity",
    "aperture": "EXIF FNumber",
}


def exr_size(data: bytes) -> tuple[int, int]:
    """(width, height) of the data window of the first part.

    Raises UnsuitableError without colours, or where they have fewer pixels; what OpenEXR raises.
    """
    header = _header(data)
    if not {one.name for one in header["channels"]}.issuperset(_COLOURS):
        raise UnsuitableError(
            "is an EXR without channels R, G and B in its first part: save it with those."
        )
    if any(
        one.name in _COLOURS and (one.xSampling, one.ySampling) != (1, 1)
        for one in header["channels"]
    ):
        # whose reader leaves what is not there as it finds it in memory
        raise UnsuitableError(
            "is an EXR whose colours have fewer pixels than the picture: save it with whole "
            "channels R, G and B."
        )
    return size_of_window(*header["dataWindow"])


def exr_place(data: bytes) -> tuple[int, int]:
    """(x, y) of the first part's data window in what is shown. Raises what OpenEXR raises."""
    header = _header(data)
    first, _ = header["dataWindow"]
    origin, _ = header["displayWindow"]
    return int(first[0]) - int(origin[0]), int(first[1]) - int(origin[1])


def exr_exposure(data: bytes) -> dict[str, float]:
    """Exposure that the first part tells, by exifread's names. Raises what OpenEXR raises."""
    header = _header(data)
    return {exif: header[name] for name, exif in _EXIF_NAMES.items() if name in header}


def read_exr(data: bytes) -> Samples:
    """Read R, G and B of the first part; its chromaticities, where it has any, as a profile.

    data: a file that exr_size takes. Raises UnsuitableError with integers, or where a transparency
    has darkened colours; ValueError and what OpenEXR raises.
    """
    with muted():
        file = OpenEXR.File(io.BytesIO(data), separate_channels=True)
        channels, header = file.channels(), file.header()
    planes = [channels[name].pixels for name in _COLOURS]
    if any(plane.dtype.kind != "f" for plane in planes):
        raise UnsuitableError("is an EXR of integers: save it with half or float channels.")
    if "A" in channels:
        refuse_premultiplied(channels["A"].pixels, 1.0)
    values = np.stack(planes, axis=-1).astype(np.float32, copy=False)
    told = header.get("chromaticities")
    profile = None if told is None else profile_of_chromaticities("EXR", told, "linear")
    return Samples(values, 1.0, profile=profile)


def _header(data: bytes) -> dict[str, Any]:
    header: dict[str, Any] = OpenEXR.File(io.BytesIO(data), header_only=True).header()
    return header

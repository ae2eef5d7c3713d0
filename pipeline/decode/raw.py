"""RAW and DNG through LibRaw: sensor values, one scale for every frame."""

from __future__ import annotations

import io
from dataclasses import dataclass

import numpy as np
import rawpy

from pipeline.decode.metadata import Metadata, read_metadata
from pipeline.decode.quiet import muted
from pipeline.decode.samples import Samples
from pipeline.frames import Exposure, Matrix

_TURNED = (5, 6)
"""LibRaw's `flip` values for a quarter turn."""


@dataclass(frozen=True)
class RawPicture:
    """A demosaiced RAW file: upright samples, white level at samples.white, and its facts."""

    samples: Samples
    metadata: Metadata
    xyz_to_camera: Matrix | None


def raw_size(data: bytes) -> tuple[int, int]:
    """(width, height) after orientation, without unpacking. Raises rawpy's errors."""
    with muted(), rawpy.imread(io.BytesIO(data)) as raw:
        width, height = raw.sizes.iwidth, raw.sizes.iheight
        return (height, width) if raw.sizes.flip in _TURNED else (width, height)


def read_raw(data: bytes) -> RawPicture:
    """Demosaic with AHD, in the camera's own colours.

    adjust_maximum_thr must be 0: LibRaw otherwise scales every frame by its own maximum, which
    gives the two frames of a pair two gains. Raises rawpy's errors.
    """
    with muted(), rawpy.imread(io.BytesIO(data)) as raw:
        values = raw.postprocess(
            demosaic_algorithm=rawpy.DemosaicAlgorithm.AHD,
            user_wb=[1.0, 1.0, 1.0, 1.0],
            output_color=rawpy.ColorSpace.raw,
            output_bps=16,
            gamma=(1, 1),
            no_auto_bright=True,
            adjust_maximum_thr=0.0,
        )
        matrix = np.asarray(raw.rgb_xyz_matrix, dtype=np.float64)[:3]
        other = raw.other
    metadata = read_metadata(data)
    if metadata == Metadata():  # no EXIF where a TIFF reader finds it, as in CR3 and RAF
        metadata = Metadata(
            exposure=Exposure(
                _known(other.shutter_speed), _known(other.iso_speed), _known(other.aperture)
            )
        )
    return RawPicture(Samples(values, 65535.0), metadata, matrix if matrix.any() else None)


def _known(value: float) -> float | None:
    return value if np.isfinite(value) and value > 0 else None

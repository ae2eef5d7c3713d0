"""RAW and DNG through LibRaw: sensor values, one scale for every frame."""

from __future__ import annotations

import io

import numpy as np
import rawpy

from pipeline.decode.metadata import Metadata, read_metadata
from pipeline.decode.quiet import muted
from pipeline.decode.samples import Samples
from pipeline.decode.tiff import dng_matrix
from pipeline.frames import Matrix
from pipeline.options import Quality

_DEMOSAICING: dict[Quality, rawpy.DemosaicAlgorithm] = {
    "best": rawpy.DemosaicAlgorithm.DHT,
    "balanced": rawpy.DemosaicAlgorithm.PPG,
    "fast": rawpy.DemosaicAlgorithm.LINEAR,
}
_TURNED = (5, 6)
"""LibRaw's `flip` values for a quarter turn."""


def raw_size(data: bytes) -> tuple[int, int]:
    """(width, height) after orientation, without unpacking. Raises rawpy's errors."""
    with rawpy.imread(io.BytesIO(data)) as raw:
        width, height = raw.sizes.iwidth, raw.sizes.iheight
        return (height, width) if raw.sizes.flip in _TURNED else (width, height)


def read_raw(data: bytes, quality: Quality) -> tuple[Samples, Metadata, Matrix | None]:
    """Upright samples, facts, and the matrix from CIE XYZ to camera RGB where it is known.

    Demosaiced in the camera's own colours, white level at samples.white. DHT does not suffer from
    channels without white balance; docs/performance.md measures it beside the plainer ways.
    adjust_maximum_thr must be 0: LibRaw otherwise scales every frame by its own maximum, which
    gives the two frames of a pair two gains. Raises rawpy's errors.
    """
    with muted(), rawpy.imread(io.BytesIO(data)) as raw:
        values = raw.postprocess(
            demosaic_algorithm=_DEMOSAICING[quality],
            user_wb=[1.0, 1.0, 1.0, 1.0],
            output_color=rawpy.ColorSpace.raw,
            output_bps=16,
            gamma=(1, 1),
            no_auto_bright=True,
            adjust_maximum_thr=0.0,
        )
        known = np.asarray(raw.rgb_xyz_matrix, dtype=np.float64)[:3]
        metadata = read_metadata(data)
        if metadata == Metadata():  # no EXIF where a TIFF reader finds it, as in CR3 and RAF
            metadata = preview_metadata(raw)
    return Samples(values, 65535.0), metadata, known if known.any() else dng_matrix(data)


def preview_metadata(raw: rawpy.RawPy) -> Metadata:
    """Facts from the embedded preview, to which LibRaw gives an EXIF block where it has none."""
    try:
        preview = raw.extract_thumb()
    except rawpy.LibRawError:
        return Metadata()
    data = preview.data
    return read_metadata(data) if isinstance(data, bytes) else Metadata()  # else a bitmap

"""RAW and DNG through LibRaw: sensor values, one scale for every frame."""

from __future__ import annotations

import io
from typing import Any, NamedTuple

import numpy as np
import rawpy
from numpy.typing import NDArray

from pipeline.decode.bayer import bayer_mosaic
from pipeline.decode.demosaic import demosaic
from pipeline.decode.dng_crop import shown_part
from pipeline.decode.dng_jxl import described, uncompressed
from pipeline.decode.dng_layout import refuse_laid_out
from pipeline.decode.dng_levels import Levels, dng_levels
from pipeline.decode.dng_linear import scaled
from pipeline.decode.dng_matrix import dng_matrix
from pipeline.decode.dng_values import refuse_misread
from pipeline.decode.linear import clipped, clipped_photosites, to_linear
from pipeline.decode.metadata import Metadata, read_metadata
from pipeline.decode.quiet import muted
from pipeline.decode.samples import Samples, UnsuitableError, refuse_grey
from pipeline.decode.saturation import RAW_CLIP, saturation
from pipeline.decode.tiff import (
    black_repeats,
    exceeds_white,
    in_planes,
    linear_raw_channels,
)
from pipeline.images.frames import Mask, Matrix, Photograph

_ORIENTATIONS = {0: 1, 1: 2, 2: 4, 3: 3, 4: 5, 5: 8, 6: 6, 7: 7}
"""EXIF orientation by LibRaw's `flip`: mirrored across (1), down (2), rows and columns changed (4).
"""
_CORRECTED = ("phase one",)
"""Makers whose sensors' faults LibRaw corrects after it has unpacked the file."""
_MOST = 65535.0
_MOST_CONDITION = 1e4
"""Of a matrix from CIE XYZ to camera RGB; beyond, two of its rows are nearly the same."""


class RawPicture(NamedTuple):
    """A RAW file, upright.

    pixels: (H, W, 3), the camera's own colours, 1 = white level. saturated: (H, W), see clipped.
    xyz_to_camera: matrix from CIE XYZ to camera RGB, None where it is not
        known, or what is known tells no three colours apart.
    """

    pixels: Photograph
    saturated: Mask
    metadata: Metadata
    xyz_to_camera: Matrix | None


def raw_header(data: bytes) -> tuple[tuple[int, int], int]:
    """(width, height) before EXIF orientation, and that, without unpacking.

    Of a DNG they are those of the part that it has shown. LibRaw knows the orientation of files
    whose EXIF nothing else finds. Raises UnsuitableError for a linear DNG of one channel or four,
    or in planes, and rawpy's errors.
    """
    channels = linear_raw_channels(data)
    if channels is not None:
        refuse_grey(channels)
    if in_planes(data):  # LibRaw takes them for pixels of three colours one after another
        raise UnsuitableError(
            "is a linear DNG with each colour in a plane of its own, which is not read: save it as "
            "a DNG of whole pixels, or as a TIFF."
        )
    plain = described(data)
    if channels is not None and channels > 3:
        raise UnsuitableError(
            f"is a linear DNG of {channels} channels, which is not read: save it as a DNG of "
            "three, or as a TIFF."
        )
    with rawpy.imread(io.BytesIO(plain)) as raw:
        part = shown_part(raw, data)
        width, height = raw.sizes.iwidth, raw.sizes.iheight
        if part is not None:
            height, width = (side.stop - side.start for side in part)
        return (width, height), _ORIENTATIONS.get(raw.sizes.flip, 1)


def read_raw(data: bytes, orientation: int | None = None) -> RawPicture:
    """Read sensor values, without white balance, as light; of a DNG the part that it has shown.

    data: a file that raw_header takes.
    orientation: by which to turn them, as EXIF has it; None for the file's own.
    Mosaics of Bayer sensors are made pictures of by demosaic, all others by LibRaw: where that
    has a choice by DHT, which does not suffer from channels without white balance either.
    adjust_maximum_thr must be 0: LibRaw otherwise scales every frame by its own maximum, which
    gives the two frames of a pair two gains. Raises UnsuitableError for floats above the white
    level, for values that LibRaw would take for others (see refuse_misread, refuse_laid_out and
    dng_levels) and for a compression that it does not know, and rawpy's errors.
    """
    data = uncompressed(data)
    if exceeds_white(data):  # LibRaw scales each of such files by its own maximum
        raise UnsuitableError(
            "is a DNG of floats with values above its white level, or that are no numbers: save it "
            "as a TIFF or an OpenEXR of floats."
        )
    refuse_misread(data)
    refuse_laid_out(data)
    metadata = read_metadata(data)
    with muted(), rawpy.imread(io.BytesIO(data)) as raw:
        _unpack(raw)
        known = np.asarray(raw.rgb_xyz_matrix, dtype=np.float64)[:3]
        if metadata == Metadata():  # no EXIF where it is looked for, as in CRW
            metadata = preview_metadata(raw)
        corrected = metadata.make.lower().startswith(_CORRECTED)
        part = shown_part(raw, data)
        turn = orientation or _ORIENTATIONS.get(raw.sizes.flip, 1)
        levels = dng_levels(data)
        mosaic = None if corrected else bayer_mosaic(raw, black_repeats(data), levels, part, turn)
        if mosaic is not None:
            pixels: Photograph = demosaic(mosaic.values, mosaic.colours, mosaic.black, mosaic.white)
            saturated = clipped_photosites(mosaic.values, mosaic.black, mosaic.white)
        else:
            share = _saturation(raw)
            values, white = _picture(raw, levels, linear_raw_channels(data) is not None)
    if mosaic is None:
        samples = Samples(values if part is None else values[part], white, turn)
        pixels, saturated = to_linear(samples, srgb=False), clipped(samples, share * white)
    matrix = known if _tells_colours(known) else dng_matrix(data)
    if matrix is not None and not _tells_colours(matrix):
        matrix = None
    return RawPicture(pixels, saturated, metadata, matrix)


def _picture(raw: rawpy.RawPy, levels: Levels | None, linear: bool) -> tuple[NDArray[Any], float]:
    """Picture (H, W, 3) of a linear DNG, or by LibRaw's demosaicing, and its value of white.

    levels: a DNG's own. Raises UnsuitableError where LibRaw would take the mean of what they differ
    by in rows and columns.
    """
    mosaic = raw.raw_type == rawpy.RawType.Flat
    if levels is not None and not mosaic:
        own = scaled(raw, levels)
        if own is not None:
            return own, _MOST
    if levels is not None and mosaic and levels.varies:
        raise UnsuitableError(
            "is a DNG of a sensor whose levels of black by rows or columns (BlackLevelDeltaV, "
            "BlackLevelDeltaH) are not read: save it as a linear DNG, or as a TIFF of 16 bits."
        )
    values = raw.postprocess(
        demosaic_algorithm=rawpy.DemosaicAlgorithm.DHT,
        user_wb=[1.0, 1.0, 1.0, 1.0],
        output_color=rawpy.ColorSpace.raw,
        output_bps=16,
        gamma=(1, 1),
        no_auto_bright=True,
        adjust_maximum_thr=0.0,
        user_flip=0,
    )
    return values, _linear_white(raw) if linear else _MOST


def _saturation(raw: rawpy.RawPy) -> float:
    """Share of the white level from which values count as clipped (see saturation)."""
    black = max(raw.black_level_per_channel)
    white = raw.white_level - black
    if raw.raw_type != rawpy.RawType.Flat or white <= 0:
        return RAW_CLIP
    return (saturation(raw.raw_image_visible, black, white) - black) / white


def _unpack(raw: rawpy.RawPy) -> None:
    try:
        raw.unpack()
    except rawpy.LibRawFileUnsupportedError as error:  # of damaged data it raises others
        raise UnsuitableError(
            "is a RAW file of a kind or compression that is not read: convert it to an "
            "uncompressed or lossless DNG."
        ) from error


def _linear_white(raw: rawpy.RawPy) -> float:
    """Return the value of white, where it is least, in LibRaw's 16 bits of a linear DNG.

    It divides by the white level less the least of four levels of black. The fourth may be that of
    no colour, and 0, while the other three are taken away.
    """
    levels = raw.black_level_per_channel
    most = raw.white_level - max(levels)
    return _MOST * most / (raw.white_level - min(levels)) if most > 0 else _MOST


def _tells_colours(matrix: Matrix) -> bool:
    """Whether a matrix (3, 3) keeps three colours apart, as that of any camera does."""
    return bool(np.isfinite(matrix).all() and np.linalg.cond(matrix) < _MOST_CONDITION)


def preview_metadata(raw: rawpy.RawPy) -> Metadata:
    """Facts from the embedded preview, to which LibRaw gives an EXIF block where it has none."""
    try:
        preview = raw.extract_thumb()
    except (rawpy.LibRawError, NotImplementedError, OSError):  # none, of another kind, damaged
        return Metadata()
    data = preview.data
    return read_metadata(data) if isinstance(data, bytes) else Metadata()  # else a bitmap

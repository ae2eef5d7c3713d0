"""One way in: bytes of any format we read → Frame."""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from functools import partial

import numpy as np

from pipeline.colour.icc import adobe_rgb_profile
from pipeline.decode.compression_noise import compression_noise
from pipeline.decode.exr import exr_place, exr_size, read_exr
from pipeline.decode.header import Header
from pipeline.decode.linear import clipped, to_linear
from pipeline.decode.metadata import Metadata, read_metadata
from pipeline.decode.profiles import is_curved, is_hdr, is_straight
from pipeline.decode.raw import raw_header, read_raw
from pipeline.decode.recompressed import compressed_as_jpeg, recompressed
from pipeline.decode.rendered import (
    heif_size,
    jpeg_size,
    png_size,
    read_heif,
    read_jpeg,
    read_png,
)
from pipeline.decode.samples import HDR, Samples, UnsuitableError, turns_sides, upright
from pipeline.decode.signatures import Kind, kind_of
from pipeline.decode.tiff import holds_raw, read_tiff, tiff_size
from pipeline.errors import ImageTooLargeError, OptionError, PipelineError, UnreadableImageError
from pipeline.images.frames import CameraFacts, Frame, Mask, Matrix, Photograph
from pipeline.images.max_pixels import max_pixels
from pipeline.images.noise import Noise

_FORMATS = "a JPEG, PNG, TIFF, OpenEXR, HEIC, DNG or a camera's RAW file"


def read_header(data: bytes, name: str = "no-flash photograph") -> Header:
    """Read what the header alone tells.

    name: what messages call the picture. Raises UnreadableImageError when the bytes are not a
    picture of a known kind, ImageTooLargeError above max_pixels().
    """
    return _header(data, _kind(data, name), name)


def decode(
    data: bytes,
    encoding: str = "auto",
    name: str = "no-flash photograph",
    orientation: int | None = None,
) -> Frame:
    """Decode a photograph to linear light.

    encoding: "auto" takes RAW and DNG as sensor values, 8-bit pictures and HEIF as their ICC
    profile says, else as sRGB, 16-bit integer TIFF and PNG and float TIFF as their ICC profile
    says, else as linear, as OpenEXR; "linear" and "srgb" say how the values of a file that is not
    RAW are encoded. Pictures whose profile is followed become linear sRGB, as do JPEG files that
    are Adobe RGB by their EXIF. What a PNG says by its cICP, sRGB, gAMA or cHRM chunk counts as its
    profile, and an OpenEXR by its chromaticities. name: what messages call the picture.
    orientation: EXIF's, 1–8, by which to turn the sensor's picture; None for the file's own.
    Raises UnreadableImageError, also for more than 8 bits with a profile of no use and "auto",
    ImageTooLargeError, and OptionError for a RAW file said to be sRGB.
    """
    kind = _kind(data, name)
    header = _header(data, kind, name)
    if kind == "RAW" and encoding == "srgb":
        raise OptionError(
            f"The {name} is a RAW file, which holds linear values: leave the encoding to auto."
        )
    with _readable(name, _damaged(kind)):
        read = (
            _raw(data, orientation)
            if kind == "RAW"
            else _picture(data, kind, encoding, orientation)
        )
        if read.pixels.ndim != 3 or read.pixels.shape[2] != 3:
            raise ValueError("a damaged header gave other samples than RGB")
    height, width = read.pixels.shape[:2]
    metadata = read.metadata
    return Frame(
        pixels=read.pixels,
        saturated=read.saturated,
        encoding=read.encoding,
        sha256=hashlib.sha256(data).hexdigest(),
        focal_px=metadata.focal_px(width, height),
        xyz_to_camera=read.xyz_to_camera,
        compression=read.compression,
        profiled=read.profiled,
        empty=read.empty,
        orientation=orientation or header.orientation,
        written_orientation=header.orientation,
        **{fact.name: getattr(metadata, fact.name) for fact in fields(CameraFacts)},
    )


@dataclass(frozen=True)
class _Read:
    """What a file holds, by the names of Frame."""

    pixels: Photograph
    saturated: Mask
    encoding: str
    metadata: Metadata
    xyz_to_camera: Matrix | None = None
    compression: Noise | None = None
    profiled: bool = False
    empty: Mask | None = None


def _raw(data: bytes, orientation: int | None) -> _Read:
    read = read_raw(data, orientation)
    return _Read(read.pixels, read.saturated, "raw", read.metadata, read.xyz_to_camera)


def _picture(data: bytes, kind: Kind, encoding: str, orientation: int | None) -> _Read:
    """A file of any other kind; encoding, orientation: as decode is asked for them."""
    metadata = read_metadata(data)
    samples = _samples(data, kind, metadata, orientation)
    if samples.empty is not None:  # what lies below is no part of the photograph
        below = np.where(samples.empty[..., None], samples.values.dtype.type(0), samples.values)
        samples = replace(samples, values=below)
    if encoding == "auto" and samples.profile is not None and is_hdr(samples.profile):
        raise UnsuitableError(HDR)
    curved = encoding == "auto" and _curved(samples)
    straight = encoding == "auto" and _straight(samples)
    if encoding == "auto" and kind != "HEIF" and not (curved or straight):
        _refuse_unusable_profile(samples)
    coded = kind == "HEIF" or samples.values.dtype == "uint8" or curved
    rendered = coded and not straight
    by_profile = encoding == "auto" and (rendered or straight)
    if encoding == "auto":
        encoding = "srgb" if rendered else "linear"
    linear = partial(to_linear, srgb=encoding == "srgb", profiled=by_profile)
    empty = None if samples.empty is None else upright(samples.empty, samples.orientation)
    bent = curved or (kind == "HEIF" and encoding == "srgb")
    saturated = clipped(samples, curved=bent, linear=encoding == "linear")
    if empty is not None:
        saturated &= ~empty  # the white of a cut-out's ground is no light
    return _Read(
        linear(samples),
        saturated,
        encoding,
        metadata,
        compression=_compression(data, kind, samples, linear),
        profiled=straight,
        empty=empty,
    )


def _compression(
    data: bytes, kind: Kind, samples: Samples, linear: Callable[[Samples], Photograph]
) -> Noise | None:
    """What a lossy file has lost, as noise of its linear values; None of one that lost nothing."""
    parts = None
    if kind == "JPEG":
        parts = recompressed(data, samples.values)
    elif kind == "HEIF":
        parts = compressed_as_jpeg(samples.values)
    if parts is None:
        return None
    codes = replace(samples, white=255.0)
    before, after = (linear(replace(codes, values=part))[:] for part in (parts.before, parts.after))
    return compression_noise(before, after, parts.repeated)


def _kind(data: bytes, name: str) -> Kind:
    if not data:
        raise UnreadableImageError(f"The {name} is empty: send the file again.")
    kind = kind_of(data)
    if kind == "TIFF":
        with _readable(name, _damaged(kind)):
            return "RAW" if holds_raw(data) else "TIFF"
    # LibRaw knows formats without a signature of their own; it has the last word.
    return kind or "RAW"


def _header(data: bytes, kind: Kind, name: str) -> Header:
    place = (0, 0)
    with _readable(name, _unopened(data, kind)):
        if kind == "RAW":
            (width, height), orientation = raw_header(data)
        else:
            width, height = _SIZES[kind](data)
            orientation = 1 if kind == "EXR" else read_metadata(data).orientation
        if kind == "EXR":
            place = exr_place(data)
        if width < 1 or height < 1:
            raise ValueError("no pixels")
    if width * height > max_pixels():
        raise ImageTooLargeError(
            f"The {name} has {width} × {height} pixels, more than the limit of "
            f"{max_pixels() / 1e6:g} million: send a smaller one."
        )
    turned = kind != "HEIF" and turns_sides(orientation)
    return Header(kind, (height, width) if turned else (width, height), orientation, place)


_SIZES: dict[Kind, Callable[[bytes], tuple[int, int]]] = {
    "JPEG": jpeg_size,
    "PNG": png_size,
    "TIFF": tiff_size,
    "EXR": exr_size,
    "HEIF": heif_size,
}
"""(width, height) before orientation; of HEIF, which libheif turns, after it."""


def _samples(data: bytes, kind: Kind, metadata: Metadata, orientation: int | None) -> Samples:
    turn = orientation or metadata.orientation
    if kind == "JPEG":
        samples = read_jpeg(data, turn)
        if metadata.adobe_rgb and samples.profile is None:
            return replace(samples, profile=adobe_rgb_profile())
        return samples
    if kind == "PNG":
        return read_png(data, turn)
    if kind == "TIFF":
        return read_tiff(data, turn)
    return read_exr(data) if kind == "EXR" else read_heif(data, metadata.orientation, orientation)


def _curved(samples: Samples) -> bool:
    """Whether a file says by its profile that its values of more than 8 bits are not linear."""
    profile = samples.profile
    return samples.values.dtype != "uint8" and profile is not None and is_curved(profile)


def _straight(samples: Samples) -> bool:
    """Whether a file says by its profile that its values are linear, and in which colours."""
    return samples.profile is not None and is_straight(samples.profile)


def _refuse_unusable_profile(samples: Samples) -> None:
    """Raise UnsuitableError for more than 8 bits whose profile is neither curved nor straight.

    They would count as linear, and whoever gave them a profile has most likely bent them. Pictures
    of 8 bits are sRGB without a profile.
    """
    if samples.values.dtype != "uint8" and samples.profile is not None:
        raise UnsuitableError(
            "has a colour profile that cannot be read, which leaves open how its values are "
            "encoded: save it with the profile of sRGB, or tell the encoding."
        )


def _damaged(kind: Kind) -> str:
    return f"is a damaged or incomplete {kind} file: send it again."


def _unopened(data: bytes, kind: Kind) -> str:
    """Say what a file may be whose header its decoder does not understand."""
    signature = kind_of(data)
    if signature is None:
        return f"is of a kind that is not read: send {_FORMATS}."
    if signature == "TIFF" and kind == "RAW":
        return (
            "is a damaged RAW file, or one or a TIFF of a kind that is not read: send the RAW file "
            "again, an uncompressed or lossless DNG of it, or a TIFF with 8-bit, 16-bit or float "
            "RGB values."
        )
    return _damaged(kind)


@contextmanager
def _readable(name: str, otherwise: str) -> Iterator[None]:
    """Turn whatever a decoder raises or warns of into one sentence."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except (PipelineError, MemoryError):
        raise
    except UnsuitableError as error:
        raise UnreadableImageError(f"The {name} {error}") from error
    except Exception as error:
        raise UnreadableImageError(f"The {name} {otherwise}") from error

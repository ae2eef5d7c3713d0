"""One way in: bytes of any format we read → Frame."""

from __future__ import annotations

import hashlib
import math
import os
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial

from pipeline.colour.icc import adobe_rgb_profile
from pipeline.compression_noise import compression_noise
from pipeline.decode.exr import exr_size, read_exr
from pipeline.decode.linear import clipped, to_linear
from pipeline.decode.metadata import Metadata, read_metadata
from pipeline.decode.profiles import is_curved, is_straight
from pipeline.decode.raw import raw_size, read_raw
from pipeline.decode.recompressed import compressed_as_jpeg, recompressed
from pipeline.decode.rendered import (
    heif_size,
    jpeg_size,
    png_size,
    read_heif,
    read_jpeg,
    read_png,
)
from pipeline.decode.samples import Samples, UnsuitableError
from pipeline.decode.signatures import Kind, kind_of
from pipeline.decode.tiff import holds_raw, read_tiff, tiff_size
from pipeline.errors import ImageTooLargeError, OptionError, PipelineError, UnreadableImageError
from pipeline.frames import Frame, Mask, Matrix, Photograph
from pipeline.noise import Noise

FORMATS = "a JPEG, PNG, TIFF, OpenEXR, HEIC, DNG or a camera's RAW file"


def max_pixels() -> float:
    """Largest number of pixels accepted: LIGHTLAYERS_MAX_PIXELS, else 200 million."""
    text = os.environ.get("LIGHTLAYERS_MAX_PIXELS", "200e6")
    try:
        limit = float(text)
    except ValueError:
        limit = math.nan
    if not limit > 0:
        raise OptionError(f"LIGHTLAYERS_MAX_PIXELS is {text!r}: set it to a number of pixels.")
    return limit


def check_header(data: bytes, name: str = "no-flash photograph") -> tuple[int, int]:
    """(width, height) after orientation, from the header alone.

    name: what messages call the picture. Raises UnreadableImageError when the bytes are not a
    picture of a known kind, ImageTooLargeError above max_pixels().
    """
    return _size(data, _kind(data, name), name)


def decode(data: bytes, encoding: str = "auto", name: str = "no-flash photograph") -> Frame:
    """Decode a photograph to linear light.

    encoding: "auto" takes RAW and DNG as sensor values, 8-bit pictures and HEIF as their ICC
    profile says, else as sRGB, 16-bit integer TIFF and PNG and float TIFF as their ICC profile
    says, else as linear, as OpenEXR; "linear" and "srgb" say how the values of a file that is not
    RAW are encoded. Pictures whose profile is followed become linear sRGB, as do JPEG files that
    are Adobe RGB by their EXIF. What a PNG says by its cICP, sRGB, gAMA or cHRM chunk counts as its
    profile, and an OpenEXR by its chromaticities. name: what messages call the picture.
    Raises UnreadableImageError, also for more than 8 bits with a profile of no use and "auto",
    ImageTooLargeError, and OptionError for a RAW file said to be sRGB.
    """
    kind = _kind(data, name)
    _size(data, kind, name)
    if kind == "RAW" and encoding == "srgb":
        raise OptionError(
            f"The {name} is a RAW file, which holds linear values: leave the encoding to auto."
        )
    with _readable(name, _damaged(kind)):
        read = _raw(data) if kind == "RAW" else _picture(data, kind, encoding)
        if read.pixels.ndim != 3 or read.pixels.shape[2] != 3:
            raise ValueError("a damaged header gave other samples than RGB")
    height, width = read.pixels.shape[:2]
    metadata = read.metadata
    return Frame(
        pixels=read.pixels,
        saturated=read.saturated,
        encoding=read.encoding,
        sha256=hashlib.sha256(data).hexdigest(),
        exposure=metadata.exposure,
        make=metadata.make,
        model=metadata.model,
        serial=metadata.serial,
        flash_fired=metadata.flash_fired,
        auto_white_balance=metadata.auto_white_balance,
        focal_px=metadata.focal_px(width, height),
        xyz_to_camera=read.xyz_to_camera,
        compression=read.compression,
        profiled=read.profiled,
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


def _raw(data: bytes) -> _Read:
    pixels, saturated, metadata, xyz_to_camera = read_raw(data)
    return _Read(pixels, saturated, "raw", metadata, xyz_to_camera)


def _picture(data: bytes, kind: Kind, encoding: str) -> _Read:
    """A file of any other kind; encoding: as decode is asked for it."""
    metadata = read_metadata(data)
    samples = _samples(data, kind, metadata)
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
    bent = curved or (kind == "HEIF" and encoding == "srgb")
    return _Read(
        linear(samples),
        clipped(samples, curved=bent),
        encoding,
        metadata,
        compression=_compression(data, kind, samples, linear),
        profiled=straight,
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


def _size(data: bytes, kind: Kind, name: str) -> tuple[int, int]:
    with _readable(name, _unopened(data, kind)):
        width, height = {
            "JPEG": jpeg_size,
            "PNG": png_size,
            "TIFF": tiff_size,
            "EXR": exr_size,
            "HEIF": heif_size,
            "RAW": raw_size,
        }[kind](data)
        if width < 1 or height < 1:
            raise ValueError("no pixels")
    if width * height > max_pixels():
        raise ImageTooLargeError(
            f"The {name} has {width} × {height} pixels, more than the limit of "
            f"{max_pixels() / 1e6:g} million: send a smaller one."
        )
    turned = kind in ("JPEG", "PNG", "TIFF") and read_metadata(data).orientation >= 5
    return (height, width) if turned else (width, height)


def _samples(data: bytes, kind: Kind, metadata: Metadata) -> Samples:
    if kind == "JPEG":
        samples = read_jpeg(data, metadata.orientation)
        if metadata.adobe_rgb and samples.profile is None:
            return replace(samples, profile=adobe_rgb_profile())
        return samples
    if kind == "PNG":
        return read_png(data, metadata.orientation)
    if kind == "TIFF":
        return read_tiff(data, metadata.orientation)
    return read_exr(data) if kind == "EXR" else read_heif(data)


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
        return f"is of a kind that is not read: send {FORMATS}."
    if signature == "TIFF" and kind == "RAW":
        return (
            "is a damaged RAW file or a TIFF of a kind that is not read: send the RAW file again, "
            "or a TIFF with 8-bit, 16-bit or float RGB values."
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

"""JPEG, PNG and HEIF: pictures made for looking at."""

from __future__ import annotations

import logging
import re
import struct
from functools import partial
from typing import Any

import imagecodecs
import numpy as np
import pillow_heif
import simplejpeg

from pipeline.decode.heif_parts import is_complete
from pipeline.decode.jpeg_header import (
    is_whole_header,
    plain_header,
    refuse_other_processes,
    tells_its_end,
)
from pipeline.decode.png_colours import png_profile, png_transfer, refuse_limited_range
from pipeline.decode.profiles import embedded_profile, nclx_profile
from pipeline.decode.samples import (
    CMYK,
    Samples,
    UnsuitableError,
    inverse,
    refuse_grey,
    refuse_hdr,
    refuse_premultiplied,
    to_rgb,
    transparent,
    upright,
)
from pipeline.images.memory import empty_codes

logging.getLogger("imagecodecs").setLevel(logging.CRITICAL)  # it tells of interlaced PNGs

_PNG_END = b"IEND\xaeB`\x82"
_EXIF_MARK = b"Exif\0\0"
_STRAY_BYTES = re.compile(r"(\d+) extraneous bytes")
_HARMLESS_BYTES = 64
_SAMPLING, _UNNAMED_SAMPLING = "subsampling", (6,)
"""What simplejpeg says of a sampling that libjpeg-turbo has no number for, and of its 4:4:1."""
_GREY_PNGS = (0, 4)
"""Colour types of a PNG without and with alpha."""
_NO_END, _JPEG_END = "Premature end of JPEG file", b"\xff\xd9"


def jpeg_size(data: bytes) -> tuple[int, int]:
    """(width, height) from the header, before orientation.

    Raises ValueError; UnsuitableError for grey pictures, CMYK, more than 8 bits and without loss,
    and colours of an unusual sampling, like 4:1:0.
    """
    refuse_other_processes(data)
    try:
        height, width, colours, _sampling = simplejpeg.decode_jpeg_header(plain_header(data))
    except (ValueError, KeyError) as error:
        unusual = _SAMPLING in str(error) or error.args == _UNNAMED_SAMPLING
        if not (unusual and is_whole_header(data)):  # says so, too, where there is none
            raise
        raise UnsuitableError(
            "is a JPEG whose colours are sampled in an unusual way, which is not read: save it "
            "with 4:4:4, 4:2:2 or 4:2:0, as most programs do, or as a TIFF."
        ) from error
    if colours in ("CMYK", "YCCK"):
        raise UnsuitableError(CMYK)
    if colours == "Gray":
        refuse_grey(1)
    return width, height


def read_jpeg(data: bytes, orientation: int) -> Samples:
    """Read a whole JPEG, with its end marker or without; a truncated or damaged one: ValueError."""
    plain = plain_header(data)
    height, width, _, _ = simplejpeg.decode_jpeg_header(plain)
    values = empty_codes((height, width, 3), np.uint8)
    decode = partial(simplejpeg.decode_jpeg, colorspace="RGB", buffer=values)
    try:
        decode(plain, strict=True)
    except ValueError as error:
        if _NO_END in str(error) and tells_its_end(plain):  # raises again where more is missing
            decode(plain + _JPEG_END, strict=True)
        else:
            # some phones fill up the end of a sound picture; more than that is damage
            stray = _STRAY_BYTES.search(str(error))
            if stray is None or int(stray[1]) > _HARMLESS_BYTES:
                raise
            decode(plain, strict=False)
    return Samples(values, 255.0, orientation, embedded_profile(data))


def png_size(data: bytes) -> tuple[int, int]:
    """(width, height) from the header, before orientation.

    Raises UnsuitableError for grey pictures, HDR and the limited range of video, ValueError or
    struct.error.
    """
    if data[12:16] != b"IHDR":
        raise ValueError("no IHDR chunk")
    refuse_hdr(png_transfer(data))
    refuse_limited_range(data)
    width, height, _depth, colour_type = struct.unpack(">IIBB", data[16:26])
    if colour_type in _GREY_PNGS:
        refuse_grey(1)
    return width, height


def read_png(data: bytes, orientation: int) -> Samples:
    """Read an 8- or 16-bit PNG: palette or RGB, without its alpha; the first of animated ones.

    What is wholly transparent is empty.
    """
    if _PNG_END not in data:
        raise ValueError("no end chunk")
    decoded = imagecodecs.png_decode(data)
    values = to_rgb(decoded)
    white = float(np.iinfo(values.dtype).max)
    return Samples(values, white, orientation, png_profile(data), transparent(decoded))


def heif_size(data: bytes) -> tuple[int, int]:
    """(width, height) as shown, which is after orientation.

    Raises UnsuitableError for grey pictures and HDR, ValueError and what libheif raises for the
    rest.
    """
    image = _open_heif(data)
    if image.mode.startswith(("L", "I")):  # of 8 bits and of more
        refuse_grey(1)
    width, height = image.size
    return width, height


def heif_exif(data: bytes) -> bytes:
    """EXIF block of a HEIF file, which starts with a TIFF header; empty where there is none.

    Its orientation is that of the sensor, see read_heif. Raises as heif_size does.
    """
    block = _open_heif(data).info.get("exif") or b""
    return bytes(block).removeprefix(_EXIF_MARK)


def read_heif(data: bytes, own: int = 1, orientation: int | None = None) -> Samples:
    """Read the primary picture of a HEIF file, which libheif has turned upright.

    EXIF orientation says nothing here: ISO/IEC 23008-12 turns pictures by `irot` and `imir`.
    But cameras write both alike: own, that of EXIF, is taken back for another orientation.
    Raises UnsuitableError for a grey picture and for colours that a transparency has darkened,
    ValueError and what libheif raises.
    """
    image = _open_heif(data)
    decoded = np.asarray(image)
    if decoded.dtype != np.uint8:  # 10 and 12 bits come shifted up to 16: fill the rest
        decoded = decoded | decoded >> image.info["bit_depth"]
    white = float(np.iinfo(decoded.dtype).max)
    values, empty = to_rgb(decoded), transparent(decoded)
    if image.premultiplied_alpha:
        refuse_premultiplied(decoded[..., 3], white)
    profile = image.info.get("icc_profile") or nclx_profile(image.info.get("nclx_profile") or {})
    if orientation is not None and orientation != own:
        back = inverse(own)
        empty = None if empty is None else upright(empty, back)
        return Samples(upright(values, back), white, orientation, profile, empty)
    return Samples(values, white, profile=profile, empty=empty)


def _open_heif(data: bytes) -> Any:
    if not is_complete(data):
        raise ValueError("parts of the coded picture are missing or damaged")
    image = pillow_heif.open_heif(data, convert_hdr_to_8bit=False)
    nclx = image.info.get("nclx_profile") or {}
    refuse_hdr(nclx.get("transfer_characteristics"))
    return image

"""From code values to linear light, and which pixels were clipped."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats32, Floats64
from pipeline.colour.curves import srgb_to_linear
from pipeline.decode.profiles import differs_from_srgb, to_linear_srgb
from pipeline.decode.samples import Samples, UnsuitableError, upright
from pipeline.decode.saturation import end_below_white, saturation
from pipeline.images.coded_image import LevelImage, TableImage
from pipeline.images.frames import Image, Mask, Photograph
from pipeline.images.memory import empty_image, releasable
from pipeline.images.strips import STRIP_ROWS, strips

_RENDERED_CLIP = 254 / 255

_DEMOSAIC_REACH = 5
"""Side of the square of pixels whose demosaiced values a clipped sensor value has reached."""

_BRIGHTEST = 65504.0
"""Largest value of a half float, as in OpenEXR; no light is so much brighter than white."""


def to_linear(samples: Samples, srgb: bool, profiled: bool = False) -> Photograph:
    """Make samples (H, W, 3), upright, linear, 1.0 = samples.white.

    srgb: the values follow the sRGB curve. profiled: they follow the profile of the file, where
    that is of other colours than sRGB, and become linear sRGB. Code values of 8 bits, and linear
    ones of 16, stay as they are; others go through a table, so a 24-megapixel photograph needs no
    copy in float64.
    Raises UnsuitableError where a float sample is no finite number or absurdly large, or above
    white where the curve of its profile ends.
    """
    values = upright(samples.values, samples.orientation)
    kind = values.dtype.kind
    profile = samples.profile if profiled else None
    if profile is not None and not differs_from_srgb(profile):
        profile = None
    convert = None if profile is None else to_linear_srgb(profile, values.dtype)
    table = None
    if kind == "u":
        codes = np.arange(np.iinfo(values.dtype).max + 1) / samples.white
        table = _curve(codes.astype(np.float32), srgb)
    if values.dtype == np.uint8 and table is not None and convert is None:
        return TableImage(releasable(values), table)
    if values.dtype == np.uint16 and not srgb and convert is None:
        return LevelImage(releasable(values), 0.0, 1.0 / samples.white)
    out = empty_image(*values.shape)
    for rows in strips(len(out), STRIP_ROWS):
        strip = values[rows]
        if kind == "f":
            if not np.abs(strip).max() <= _BRIGHTEST:  # nor is NaN
                raise UnsuitableError(
                    "holds values that are no light (infinite, not a number or above 65504): "
                    "save it anew with 1.0 as white."
                )
            if convert is not None and strip.max() > 1.0 and not _goes_on(convert):
                raise UnsuitableError(
                    "holds values above white (1.0), where the curve of its colour profile ends: "
                    "save it anew in linear values."
                )
        if convert is not None:
            out[rows] = convert(_full_range(strip, samples.white))
        elif table is not None:
            cv2.LUT(strip, table, dst=out[rows])
        else:
            out[rows] = _curve(strip, srgb)
    return out


def clipped(
    samples: Samples, clip: float | None = None, curved: bool = False, linear: bool = False
) -> Mask:
    """Pixels (H, W), upright, with a clipped channel.

    clip: of RAW, the value from which a sensor's count as clipped, with the pixels around whose
        demosaiced values came from them; None for other files. linear: the values of another file
        are, so that channels whose values pile up below white are clipped there.
    8 bits: 254 and above (the last code values before white are bent by the camera's curve and
    by JPEG), and as much of white where 16 bits are curved. 16 bits else: white itself. Float files
    say nothing of where the sensor ended, save one whose largest value is exactly 1: that has been
    cut off there.
    """
    values = upright(samples.values, samples.orientation)
    if values.dtype.kind == "f":
        limit = 1.0 if values.size and values.max() == 1.0 else np.inf
        below: float = np.nextafter(np.float32(limit), np.float32(0))
    elif clip is not None:
        below = np.ceil(clip) - 1
    elif curved:
        below = np.ceil(_RENDERED_CLIP * samples.white) - 1
    else:
        below = samples.white - (2 if values.dtype == np.uint8 else 1)
    upper = [float(below)] * 3
    if linear:
        ends = [end_below_white(values[..., channel], samples.white) for channel in range(3)]
        upper = [
            most if end is None else _just_below(end, values)
            for end, most in zip(ends, upper, strict=True)
        ]
    mask = np.empty(values.shape[:2], np.bool_)
    for rows in strips(len(values), STRIP_ROWS):
        within = cv2.inRange(values[rows], (-np.inf,) * 3, tuple(upper))
        np.equal(within, 0, out=mask[rows])
    return mask if clip is None else _reached(mask.view(np.uint8))


def _just_below(end: float, values: NDArray[Any]) -> float:
    if values.dtype.kind == "f":
        return float(np.nextafter(np.float32(end), np.float32(0)))
    return float(np.ceil(end)) - 1


def clipped_photosites(mosaic: NDArray[np.uint16], black: Floats64, white: float) -> Mask:
    """Pixels (H, W) around photosites (H, W) that are clipped (see saturation).

    black: (2, 2), of the upper left photosites. white: what is measured between the least of black
    and the white level. Equal to clipped of the picture that is made of them.
    """
    mask = np.empty(mosaic.shape, np.bool_)
    for y in range(2):
        limits = [saturation(mosaic[y::2, x::2], black[y, x], white) for x in range(2)]
        row = np.resize(limits, mosaic.shape[1]).astype(np.float32)
        np.greater_equal(mosaic[y::2], row, out=mask[y::2])
    return _reached(mask.view(np.uint8))


def _reached(mask: NDArray[Any]) -> Mask:
    """Pixels whose values came from clipped ones (not 0), too; the mask is written over."""
    square = np.ones((_DEMOSAIC_REACH, _DEMOSAIC_REACH), np.uint8)
    cv2.dilate(mask, square, dst=mask)
    reached = mask.view(np.bool_)
    np.not_equal(mask, 0, out=reached)
    return reached


def _goes_on(convert: Callable[[NDArray[Any]], Image]) -> bool:
    """Whether what makes floats linear tells white from what is brighter."""
    white = np.ones((1, 1, 3), np.float32)
    return bool((convert(2 * white) > 1.5 * convert(white)).all())


def _full_range(codes: NDArray[Any], white: float) -> NDArray[Any]:
    """Code values of which the largest of their type is white, as profiles have it; floats stay."""
    if codes.dtype.kind == "f":
        return codes
    largest = np.iinfo(codes.dtype).max
    if white == largest:
        return codes
    return np.asarray(np.round(codes * (largest / white)), dtype=codes.dtype)


def _curve(values: Floats32, srgb: bool) -> Floats32:
    return srgb_to_linear(values) if srgb else values

"""The photographs as the pipeline sees them."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats, Floats32, Floats64
from pipeline.images.coded_image import CodedImage
from pipeline.images.memory import release_rows
from pipeline.images.noise import Noise

Image = Floats32
Mask = NDArray[np.bool_]
Matrix = Floats64
Plane = Floats32
Planes = tuple[Plane, Plane, Plane]
Photograph = Image | CodedImage
"""Linear pixels (H, W, 3), in memory as they are or as code values."""

Numbers = tuple[float, ...]
Colour = tuple[Any, Any, Any]
"""Three channels in a compiled loop: of one pixel, or of a row of them."""


def numbers_of(array: Floats) -> Numbers:
    """Entries of an array, row by row, as compiled loops keep them in registers.

    Of an array among their arguments they would not know that nothing writes to it.
    """
    return tuple(array.ravel().tolist())


def planes_of(image: Image) -> Planes:
    """Channels (h, w) of an image (h, w, 3), contiguous: its own memory where it lies by planes.

    Compiled loops work on planes, since compilers make vector instructions of those alone.
    """
    return (
        np.ascontiguousarray(image[..., 0]),
        np.ascontiguousarray(image[..., 1]),
        np.ascontiguousarray(image[..., 2]),
    )


def rows_by_planes(photograph: Photograph, rows: slice) -> Image:
    """Some rows (h, W, 3) of a photograph, by planes."""
    height, width, _ = photograph.shape
    laid = by_planes(len(range(*rows.indices(height))), width, 3)
    write_planes(photograph, rows, channels_first(laid))
    return laid


def write_planes(photograph: Photograph, rows: slice, planes: Image) -> None:
    """Write some rows of a photograph into planes (3, h, W)."""
    if isinstance(photograph, CodedImage):
        photograph.write_planes(rows, planes)
    else:
        cv2.split(photograph[rows], tuple(planes))


def release_photograph(photograph: Photograph, stop: int) -> None:
    """Give the memory of a photograph's rows before `stop` back, where it can be."""
    if isinstance(photograph, CodedImage):
        photograph.release_rows(stop)
    else:
        release_rows(photograph, stop)


def channels_first(images: Image) -> Image:
    """Images (…, h, w, 3) as (…, 3, h, w), contiguous: their own memory if it lies by planes."""
    return np.ascontiguousarray(np.moveaxis(images, -1, -3))


def by_planes(*shape: int) -> Image:
    """Make an empty float32 array (…, h, w, 3) that lies in memory by planes."""
    return np.moveaxis(np.empty((*shape[:-3], shape[-1], *shape[-3:-1]), np.float32), -3, -1)


@dataclass(frozen=True)
class Exposure:
    """What the camera wrote about the exposure; None where it wrote nothing.

    time_s: shutter time in seconds. iso: ISO speed. f_number: relative aperture.
    """

    time_s: float | None = None
    iso: float | None = None
    f_number: float | None = None

    def times(self, other: Exposure) -> float | None:
        """By how many times this is the other, as time·ISO/N²; None where that is not known.

        Both must know the time. ISO and f-number that neither knows count as equal: lenses without
        contacts tell no f-number, and stay as they are between two photographs.
        """
        if not self.time_s or not other.time_s:
            return None
        ratio = self.time_s / other.time_s
        for one, another, power in (
            (self.iso, other.iso, 1),
            (self.f_number, other.f_number, -2),
        ):
            if one and another:
                ratio *= (one / another) ** power
            elif one or another:
                return None
        return ratio


@dataclass(frozen=True, kw_only=True)
class CameraFacts:
    """What the camera wrote beside a photograph; None and "" where it wrote nothing usable.

    make, model, serial: of the camera. flash_fired: EXIF Flash bit 0. auto_white_balance: EXIF
    WhiteBalance is automatic. baseline_ev: BaselineExposure of a DNG, by how many stops its values
    are shown brighter.
    """

    exposure: Exposure = field(default_factory=Exposure)
    make: str = ""
    model: str = ""
    serial: str = ""
    flash_fired: bool | None = None
    auto_white_balance: bool | None = None
    baseline_ev: float = 0.0


@dataclass(frozen=True)
class Frame(CameraFacts):
    """One photograph in linear camera RGB.

    pixels: (H, W, 3), linear, 1.0 = white level of the sensor (or of the file), black 0;
        negative values are kept where the file holds them (noise around black).
    saturated: bool (H, W), true where a channel was clipped.
    encoding: how the values came: "raw" (sensor values), "linear" or "srgb" (decoded with the
        sRGB curve, so linear only as far as the camera followed it).
    sha256: hexadecimal digest of the file's bytes.
    focal_px: focal length in pixels of this frame, None where unknown.
    xyz_to_camera: (3, 3) matrix from CIE XYZ to camera RGB as LibRaw knows it, None for others.
    compression: the noise that the file's compression added, None where that is not known.
    empty: bool (H, W), true where the file is transparent and shows nothing; None where nowhere.
    profiled: the file says by a linear profile what colours it holds; they became linear sRGB.
    orientation: EXIF's, 1–8, by which the sensor's picture was turned.
    written_orientation: what the file says of it, which is another where it was read as the other
        photograph of its pair.
    """

    pixels: Photograph
    saturated: Mask
    encoding: str
    sha256: str
    focal_px: float | None = None
    xyz_to_camera: Matrix | None = None
    compression: Noise | None = None
    profiled: bool = False
    empty: Mask | None = None
    orientation: int = 1
    written_orientation: int = 1

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) in pixels."""
        return self.pixels.shape[1], self.pixels.shape[0]

    @property
    def in_colour_space(self) -> bool:
        """Whether the file says that its colours are those of a space, not of a sensor."""
        return self.encoding == "srgb" or self.profiled

    @property
    def undeclared(self) -> bool:
        """Whether it holds linear values and no profile says of what: of a sensor, or sRGB."""
        return self.encoding == "linear" and not self.profiled

    @property
    def unusable(self) -> Mask:
        """Pixels (H, W) whose values tell nothing of light: saturated or empty."""
        return self.saturated if self.empty is None else self.saturated | self.empty

    def facts(self) -> Frame:
        """The frame with black pixels that take no memory, for what is known about it."""
        return replace(
            self,
            pixels=np.broadcast_to(np.float32(0.0), self.pixels.shape),
            saturated=np.broadcast_to(np.False_, self.saturated.shape),
            empty=None,
        )

"""Photographs as files: 14-bit Bayer DNG, and the JPEG that the camera renders itself.

Sources: Adobe DNG 1.4 specification; CIPA DC-008 (EXIF 2.32); IEC 61966-2-1 (sRGB).
"""

from __future__ import annotations

import io
import struct
from dataclasses import dataclass
from datetime import datetime
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from drivers.sim import spectra
from drivers.sim.sensor import BLACK, WHITE

_CROP_FACTOR = 1.53  # of the camera's sensor against 35 mm film
_EXIF_DIRECTORY = 0x8769
_PLACEHOLDER = 0x876A  # tifffile keeps the EXIF directory's tag to itself; this one sorts alike
_D65 = 21  # EXIF's number of this light source
_JPEG_QUALITY = 95
_ROWS = 256  # rendered at once
_XYZ_TO_SRGB = np.array(
    [[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]]
)


@dataclass(frozen=True)
class Shooting:
    """How a photograph was taken. time_s: seconds. focal_35mm: mm, as on 35 mm film."""

    time_s: Fraction
    f_number: Fraction
    iso: int
    flash_fired: bool
    focal_35mm: float
    taken: datetime

    def exif(self) -> dict[int, int | Fraction | str]:
        """Tag → value of the EXIF directory."""
        return {
            0x829A: self.time_s,
            0x829D: self.f_number,
            0x8822: 1,  # ExposureProgram: manual
            0x8827: self.iso,
            0x9003: self.stamp,
            0x9209: 0x09 if self.flash_fired else 0x10,  # told to fire and fired, or told not to
            0x920A: Fraction(round(10 * self.focal_35mm / _CROP_FACTOR), 10),
            0xA405: round(self.focal_35mm),
        }

    @property
    def stamp(self) -> str:
        """Date and time as EXIF writes them."""
        return self.taken.strftime("%Y:%m:%d %H:%M:%S")


def write_dng(raw: NDArray[np.uint16], shooting: Shooting) -> bytes:
    """Write an uncompressed DNG of an RGGB mosaic, (H, W), values BLACK…WHITE."""
    import tifffile

    matrix = [round(float(value) * 10_000) for value in spectra.xyz_to_camera().ravel()]
    neutral = [round(float(value) * 10_000) for value in spectra.neutral()]
    extra = [  # tag, type, count, value
        (271, "s", 0, spectra.MAKE, True),
        (272, "s", 0, spectra.MODEL, True),
        (274, "H", 1, 1, True),
        (306, "s", 0, shooting.stamp, True),
        (33421, "H", 2, (2, 2), True),  # CFARepeatPatternDim
        (33422, "B", 4, (0, 1, 1, 2), True),  # CFAPattern: red, green, green, blue
        (_PLACEHOLDER, "I", 1, 0, True),
        (50706, "B", 4, (1, 4, 0, 0), True),  # DNGVersion
        (50707, "B", 4, (1, 1, 0, 0), True),  # DNGBackwardVersion
        (50708, "s", 0, f"{spectra.MAKE} {spectra.MODEL}", True),
        (50714, "H", 1, BLACK, True),
        (50717, "H", 1, WHITE, True),
        (50721, "2i", 9, _rationals(matrix), True),  # ColorMatrix1
        (50728, "2I", 3, _rationals(neutral), True),  # AsShotNeutral
        (50778, "H", 1, _D65, True),  # CalibrationIlluminant1
    ]
    file = io.BytesIO()
    tifffile.imwrite(
        file,
        raw,
        photometric="cfa",
        byteorder="<",
        metadata=None,
        software=False,
        extratags=extra,
    )
    file.seek(0)
    with tifffile.TiffFile(file) as tiff:
        entry_at = tiff.pages.first.tags[_PLACEHOLDER].offset
    data = bytearray(file.getvalue())
    struct.pack_into("<HHII", data, entry_at, _EXIF_DIRECTORY, 4, 1, len(data))
    return bytes(data) + _directory(shooting.exif(), len(data))


def write_jpeg(raw: NDArray[np.uint16], shooting: Shooting) -> bytes:
    """Write an 8-bit sRGB JPEG, rendered for daylight, of an RGGB mosaic (H, W)."""
    import cv2
    from PIL import Image
    from PIL.TiffImagePlugin import IFDRational

    scaled = np.clip(raw, BLACK, WHITE) - np.uint16(BLACK)
    # OpenCV names mosaics by their second row and column: RGGB is its "BayerBG"
    rgb = cv2.cvtColor(scaled, cv2.COLOR_BayerBG2RGB_EA)
    white = (spectra.neutral() * (WHITE - BLACK)).astype(np.float32)
    matrix = _camera_to_srgb().T.astype(np.float32)
    rendered = np.empty(rgb.shape, np.uint8)
    for top in range(0, len(rgb), _ROWS):
        rows = slice(top, top + _ROWS)
        linear = np.clip(np.minimum(rgb[rows] / white, 1) @ matrix, 0, 1)
        curved = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
        rendered[rows] = np.rint(curved * 255)
    picture = Image.fromarray(rendered)
    exif = Image.Exif()
    exif.update({271: spectra.MAKE, 272: spectra.MODEL, 274: 1, 306: shooting.stamp})
    exif.get_ifd(_EXIF_DIRECTORY).update(
        {
            tag: IFDRational(value) if isinstance(value, Fraction) else value
            for tag, value in shooting.exif().items()
        }
    )
    file = io.BytesIO()
    picture.save(file, "JPEG", quality=_JPEG_QUALITY, subsampling=0, exif=exif)
    return file.getvalue()


def _camera_to_srgb() -> NDArray[np.float64]:
    """Compute the matrix from white-balanced camera RGB to linear sRGB, white kept white."""
    matrix = _XYZ_TO_SRGB @ np.linalg.inv(spectra.xyz_to_camera()) @ np.diag(spectra.neutral())
    return np.asarray(matrix / matrix.sum(axis=1, keepdims=True))


def _rationals(numerators: list[int]) -> list[int]:
    return [part for numerator in numerators for part in (numerator, 10_000)]


def _directory(tags: dict[int, int | Fraction | str], offset: int) -> bytes:
    """Write a TIFF directory whose first byte will lie at offset in its file."""
    after = offset + 2 + 12 * len(tags) + 4
    entries, values = b"", b""
    for tag, value in sorted(tags.items()):
        if isinstance(value, int):
            entries += struct.pack("<HHIHH", tag, 3, 1, value, 0)
            continue
        if isinstance(value, str):
            kind, data = 2, value.encode("ascii") + b"\0"
            count = len(data)
            data += b"\0" * (len(data) % 2)
        else:
            kind, count = 5, 1
            data = struct.pack("<II", value.numerator, value.denominator)
        entries += struct.pack("<HHII", tag, kind, count, after + len(values))
        values += data
    return struct.pack("<H", len(tags)) + entries + struct.pack("<I", 0) + values

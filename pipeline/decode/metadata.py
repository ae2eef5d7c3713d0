"""What the camera wrote beside the pixels. Bad EXIF is no reason to refuse a photograph."""

from __future__ import annotations

import io
import logging
import math
import warnings
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import exifread

from pipeline.decode.exr import exr_exposure
from pipeline.decode.jpeg_header import exif_block
from pipeline.decode.raw_exif import cr3_directories, raf_jpeg
from pipeline.decode.rendered import heif_exif
from pipeline.decode.signatures import kind_of
from pipeline.decode.tiff import Tag, holds_raw, tiff_tags
from pipeline.images.frames import CameraFacts, Exposure

logging.getLogger("exifread").setLevel(logging.CRITICAL)  # it tells the terminal of odd tags

_MM_PER_UNIT = {2: 25.4, 3: 10.0, 4: 1.0, 5: 0.001}
_FULL_FRAME_DIAGONAL_MM = math.hypot(36.0, 24.0)

_ADOBE_RGB, _UNCALIBRATED, _ADOBE_RGB_INDEX = 2, 0xFFFF, "R03"
_LONGEST_TEXT = 64
_ISO_NAMES = ("EXIF ISOSpeedRatings", "EXIF PhotographicSensitivity", "Image ISOSpeedRatings")
_ISO_FURTHER_NAMES = (
    "EXIF RecommendedExposureIndex",
    "EXIF StandardOutputSensitivity",
    "EXIF Tag 0x8831",  # the same, which exifread has no name for
    "EXIF ISOSpeed",
)
_TIME_S = (1e-6, 1e5)
_ISO = (1.0, 1e8)
_ISO_BEYOND = 65535
_F_NUMBER = (0.3, 1000.0)
_FOCAL_MM = (0.5, 10_000.0)
_FOCAL_SHARE = (0.05, 200.0)
_MOST_APEX = 64.0
"""What a camera can have written; anything else is a broken block and counts as unknown."""


@dataclass(frozen=True)
class Metadata(CameraFacts):
    """All EXIF facts about a photograph that are read; None where the file says nothing usable.

    orientation: 1–8 as EXIF 2.32 defines it. focal_35mm: equivalent focal length in mm.
    focal_plane: focal length as a share of the picture's long side, from the resolution of the
    focal plane. taken_s: when, in seconds by the camera's own clock, whatever its time zone.
    adobe_rgb: the values are Adobe RGB.
    """

    orientation: int = 1
    focal_35mm: float | None = None
    focal_plane: float | None = None
    taken_s: float | None = None
    adobe_rgb: bool = False

    def focal_px(self, width: int, height: int) -> float | None:
        """Focal length in pixels of a frame of this size, None where unknown.

        The equivalent focal length is the one of equal diagonal view on 36 × 24 mm (EXIF 2.32).
        """
        if self.focal_35mm:
            return self.focal_35mm / _FULL_FRAME_DIAGONAL_MM * math.hypot(width, height)
        return self.focal_plane * max(width, height) if self.focal_plane else None


def read_metadata(data: bytes) -> Metadata:
    """Facts from the EXIF of a JPEG, TIFF, PNG, HEIF, CR3, RAF or TIFF-like RAW; never raises.

    Of an EXR, which has none, its exposure.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            tags = _tags(data)
    except Exception:  # a broken EXIF block makes exifread raise whatever it ran into
        return Metadata()
    flash = _number(tags, "EXIF Flash", "Image Flash")
    orientation = _number(tags, "Image Orientation")
    white_balance = _number(tags, "EXIF WhiteBalance")
    return Metadata(
        exposure=Exposure(
            time_s=_within(_TIME_S, tags, "EXIF ExposureTime", "Image ExposureTime")
            or _of_apex(_TIME_S, tags, "EXIF ShutterSpeedValue", -1.0),
            iso=_iso(tags),
            f_number=_within(_F_NUMBER, tags, "EXIF FNumber", "Image FNumber")
            or _of_apex(_F_NUMBER, tags, "EXIF ApertureValue", 0.5),
        ),
        make=_text(tags, "Image Make"),
        model=_text(tags, "Image Model"),
        serial=_text(tags, "EXIF BodySerialNumber"),
        flash_fired=None if flash is None else bool(int(flash) & 1),
        auto_white_balance=None if white_balance is None else white_balance == 0,
        orientation=int(orientation) if orientation and orientation in range(1, 9) else 1,
        focal_35mm=_within(_FOCAL_MM, tags, "EXIF FocalLengthIn35mmFilm"),
        focal_plane=_focal_plane(tags),
        taken_s=_taken(tags),
        adobe_rgb=_is_adobe_rgb(tags),
        baseline_ev=_number(tags, "Image Tag 0xC62A") or 0.0,  # which exifread has no name for
    )


def _tags(data: bytes) -> dict[str, Any]:
    kind = kind_of(data)
    if kind == "TIFF" and not holds_raw(data):
        return dict(tiff_tags(data))
    if kind == "EXR":
        return {name: Tag((value,)) for name, value in exr_exposure(data).items()}
    if directories := cr3_directories(data):
        image, exif = map(_read, directories)
        return image | {name.replace("Image ", "EXIF "): tag for name, tag in exif.items()}
    # exifread itself finds the block of hardly any HEIF but that of phones, and in a JPEG only one
    # that comes first
    if kind == "HEIF":
        return _read(heif_exif(data))
    jpeg = data if kind == "JPEG" else raf_jpeg(data)
    return _read(data if jpeg is None else exif_block(jpeg))


def _read(block: bytes) -> dict[str, Any]:
    with io.BytesIO(block) as file:
        tags: dict[str, Any] = exifread.process_file(file, details=False, extract_thumbnail=False)
    return tags


def _is_adobe_rgb(tags: dict[str, Any]) -> bool:
    """Whether values are Adobe RGB: as DCF 2.0 has it, or by a number of no standard."""
    space = _number(tags, "EXIF ColorSpace")
    index = _text(tags, "Interoperability InteroperabilityIndex")
    return space == _ADOBE_RGB or (space == _UNCALIBRATED and index == _ADOBE_RGB_INDEX)


def _taken(tags: dict[str, Any]) -> float | None:
    try:
        written = _text(tags, "EXIF DateTimeOriginal") or _text(tags, "Image DateTimeOriginal")
        moment = datetime.strptime(written, "%Y:%m:%d %H:%M:%S")
    except ValueError:
        return None
    fraction = _text(tags, "EXIF SubSecTimeOriginal")
    subseconds = float(f"0.{fraction}") if fraction.isascii() and fraction.isdecimal() else 0.0
    return moment.replace(tzinfo=UTC).timestamp() + subseconds


def _focal_plane(tags: dict[str, Any]) -> float | None:
    focal_mm = _within(_FOCAL_MM, tags, "EXIF FocalLength")
    resolution = _number(tags, "EXIF FocalPlaneXResolution")
    unit = _number(tags, "EXIF FocalPlaneResolutionUnit") or 2
    sides = [_number(tags, f"EXIF ExifImage{side}") or 0 for side in ("Width", "Length")]
    if not focal_mm or not resolution or unit not in _MM_PER_UNIT or max(sides) <= 0:
        return None
    share = focal_mm * resolution / _MM_PER_UNIT[int(unit)] / max(sides)
    low, high = _FOCAL_SHARE
    return share if low <= share <= high else None


def _number(tags: dict[str, Any], *names: str) -> float | None:
    for name in names:
        try:
            value = tags[name].values[0]
            # exifread leaves floats, which Pillow writes for rationals, in tuples
            value = float(value[0] if isinstance(value, tuple) else value)
        except (KeyError, IndexError, TypeError, ValueError, AttributeError, ZeroDivisionError):
            continue
        if math.isfinite(value):
            return value
    return None


def _iso(tags: dict[str, Any]) -> float | None:
    """ISO speed; 65535 stands for all above it, which other tags tell (EXIF 2.32, 4.6.5)."""
    iso = _within(_ISO, tags, *_ISO_NAMES)
    if iso is None or iso >= _ISO_BEYOND:
        return _within(_ISO, tags, *_ISO_FURTHER_NAMES)
    return iso


def _of_apex(
    limits: tuple[float, float], tags: dict[str, Any], name: str, stops: float
) -> float | None:
    """What an APEX value means, 2 to the power of it times stops; 0 is written for not known."""
    value = _number(tags, name)
    if not value or abs(value) > _MOST_APEX:
        return None
    meant = 2.0 ** (stops * value)
    return meant if limits[0] <= meant <= limits[1] else None


def _within(limits: tuple[float, float], tags: dict[str, Any], *names: str) -> float | None:
    """Give the first number of these tags within limits; a 0 in one says nothing of the others."""
    values = (_number(tags, name) for name in names)
    return next((v for v in values if v is not None and limits[0] <= v <= limits[1]), None)


def _text(tags: dict[str, Any], name: str) -> str:
    value = getattr(tags.get(name), "values", "")
    if not isinstance(value, str):
        return ""
    return "".join(filter(str.isprintable, value)).strip()[:_LONGEST_TEXT]

"""What a photograph says about its exposure, read from its EXIF."""

from __future__ import annotations

import io
import struct
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from drivers.errors import PairVerificationError

_RAF = b"FUJIFILMCCD-RAW"
_CR3 = b"ftypcrx "
_CANON = bytes.fromhex("85c0b687820f11e08111f4ce462b6a48")  # of the box with Canon's facts


@dataclass(frozen=True)
class ExposureFacts:
    """Exposure as the camera wrote it.

    time_s: seconds. f_number: relative aperture, None of a lens that tells the camera none. iso:
    speed. flash_fired: EXIF Flash bit 0.
    """

    time_s: Fraction
    f_number: Fraction | None
    iso: int
    flash_fired: bool


def read_exposure(photograph: bytes) -> ExposureFacts:
    """Read the exposure from a JPEG, a TIFF, or a RAW file that is a TIFF, CR3 or RAF.

    Raises PairVerificationError where the file does not tell.
    """
    import exifread

    try:
        tags = exifread.process_file(io.BytesIO(_with_exif(photograph)), details=False)
    except Exception as error:  # exifread raises anything at all on damaged files
        raise PairVerificationError(
            "A photograph came without readable EXIF, so that the pair cannot be checked: take the "
            "two photographs by hand and separate their files."
        ) from error
    return ExposureFacts(
        time_s=_first(tags, "ExposureTime"),
        f_number=_first_or_none(tags, "FNumber") or None,  # 0, too, stands for none
        iso=int(_first(tags, "ISOSpeedRatings")),
        flash_fired=bool(int(_first(tags, "Flash")) & 1),
    )


def _with_exif(photograph: bytes) -> bytes:
    """Give what exifread can read: of RAF the JPEG in it, of CR3 its EXIF directory alone.

    Sources: libopenraw's description of RAF; Laurent Clévy's of CR3.
    """
    if photograph.startswith(_RAF):
        start, size = struct.unpack_from(">II", photograph, 84)
        return photograph[start : start + size]
    if photograph[4:12] == _CR3:
        return _box(_box(_box(photograph, b"moov"), b"uuid" + _CANON), b"CMT2")
    return photograph


def _box(boxes: bytes, name: bytes) -> bytes:
    """Give what is in the first box of that name, nothing where there is none (ISO 14496-12)."""
    at = 0
    while at + 8 <= len(boxes):
        (size,) = struct.unpack_from(">I", boxes, at)
        if boxes.startswith(name, at + 4):
            return boxes[at + 4 + len(name) : at + size]
        if size < 8:  # it ends with the file, or is larger than 4 GB: what is sought comes before
            break
        at += size
    return b""


def _first(tags: dict[str, Any], name: str) -> Fraction:
    value = _first_or_none(tags, name)
    if value is None:
        raise PairVerificationError(
            f"A photograph came without {name} in its EXIF, so that the pair cannot be checked: "
            "take the two photographs by hand and separate their files."
        )
    return value


def _first_or_none(tags: dict[str, Any], name: str) -> Fraction | None:
    try:
        # "Image": where the EXIF directory comes alone
        value = (tags.get(f"EXIF {name}") or tags[f"Image {name}"]).values[0]
        return Fraction(value.numerator, value.denominator)
    except (KeyError, IndexError, AttributeError, TypeError, ZeroDivisionError):
        return None

"""What a photograph says about its exposure, read from its EXIF."""

from __future__ import annotations

import io
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from drivers.errors import PairVerificationError


@dataclass(frozen=True)
class ExposureFacts:
    """Exposure as the camera wrote it.

    time_s: seconds. f_number: relative aperture. iso: speed. flash_fired: EXIF Flash bit 0.
    """

    time_s: Fraction
    f_number: Fraction
    iso: int
    flash_fired: bool


def read_exposure(photograph: bytes) -> ExposureFacts:
    """Read the exposure from a DNG, TIFF or JPEG.

    Raises PairVerificationError where the file does not tell.
    """
    import exifread

    try:
        tags = exifread.process_file(io.BytesIO(photograph), details=False)
    except Exception as error:  # exifread raises anything at all on damaged files
        raise PairVerificationError(
            "A photograph came without readable EXIF, so that the pair cannot be checked."
        ) from error
    return ExposureFacts(
        time_s=_first(tags, "ExposureTime"),
        f_number=_first(tags, "FNumber"),
        iso=int(_first(tags, "ISOSpeedRatings")),
        flash_fired=bool(int(_first(tags, "Flash")) & 1),
    )


def _first(tags: dict[str, Any], name: str) -> Fraction:
    try:
        value = tags[f"EXIF {name}"].values[0]
        return Fraction(value.numerator, value.denominator)
    except (KeyError, IndexError, AttributeError, TypeError, ZeroDivisionError) as error:
        raise PairVerificationError(
            f"A photograph came without {name} in its EXIF, so that the pair cannot be checked."
        ) from error

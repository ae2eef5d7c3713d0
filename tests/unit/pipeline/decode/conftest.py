from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
import tifffile
from numpy.typing import NDArray
from PIL import Image as PillowImage

Codes = NDArray[np.uint8]
EXIF_IFD = 0x8769


@pytest.fixture
def codes() -> Codes:
    """A smooth colour picture, 48 rows of 64 pixels: JPEG keeps it within a few code values."""
    x, y = np.meshgrid(np.linspace(0, 1, 64), np.linspace(0, 1, 48))
    picture = np.stack([40 + 150 * x, 200 - 160 * y, 60 + 120 * x * y], axis=-1)
    return np.asarray(np.rint(picture), dtype=np.uint8)


@pytest.fixture
def exif_of() -> Callable[..., PillowImage.Exif]:
    """Build an EXIF block from main tags and tags of the EXIF directory."""

    def build(main: dict[int, Any], photo: dict[int, Any]) -> PillowImage.Exif:
        exif = PillowImage.Exif()
        exif.update(main)
        exif.get_ifd(EXIF_IFD).update(photo)
        return exif

    return build


@pytest.fixture
def pillow_file() -> Callable[..., bytes]:
    """Write 8-bit code values in any format and mode of Pillow."""

    def write(codes: Codes, kind: str, mode: str = "RGB", **options: Any) -> bytes:
        file = io.BytesIO()
        PillowImage.fromarray(codes).convert(mode).save(file, kind, **options)
        return file.getvalue()

    return write


@pytest.fixture
def tiff_file() -> Callable[..., bytes]:
    """Write an array with tifffile."""

    def write(values: NDArray[Any], **options: Any) -> bytes:
        file = io.BytesIO()
        tifffile.imwrite(file, values, metadata=None, **{"photometric": "rgb", **options})
        return file.getvalue()

    return write


@pytest.fixture
def exr_file(tmp_path: Path) -> Callable[..., bytes]:
    """Write channels with OpenEXR."""

    def write(**channels: NDArray[Any]) -> bytes:
        path = tmp_path / "picture.exr"
        header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
        OpenEXR.File(header, channels).write(str(path))
        return path.read_bytes()

    return write


@pytest.fixture
def dng_file(tiff_file: Callable[..., bytes]) -> Callable[..., bytes]:
    """Write an RGGB mosaic as a DNG; more TIFF tags may be given as (tag, type, count, value)."""

    def write(
        raw: NDArray[np.uint16], black: int = 600, white: int = 15892, more: tuple[Any, ...] = ()
    ) -> bytes:
        tags = [
            (33421, "H", 2, (2, 2)),  # CFARepeatPatternDim
            (33422, "B", 4, (0, 1, 1, 2)),  # CFAPattern: red, green, green, blue
            (50706, "B", 4, (1, 4, 0, 0)),  # DNGVersion
            (50707, "B", 4, (1, 1, 0, 0)),  # DNGBackwardVersion
            (50708, "s", 0, "Unheard Of One"),  # UniqueCameraModel
            (50714, "H", 1, black),
            (50717, "H", 1, white),
            *more,
        ]
        return tiff_file(
            raw,
            photometric="cfa",
            software=False,
            extratags=[(*tag, True) for tag in sorted(tags)],
        )

    return write


@pytest.fixture
def dng(tiff_file: Callable[..., bytes]) -> Callable[..., bytes]:
    """Write values (H, W) of an RGGB mosaic or linear (H, W, 3), uncompressed; tags over those."""

    def write(values: NDArray[Any], *tags: tuple[Any, ...], **options: Any) -> bytes:
        known: dict[int, tuple[Any, ...]] = {
            50706: (50706, "B", 4, (1, 7, 0, 0)),
            50708: (50708, "s", 0, "Unheard Of One"),
        }
        if values.ndim == 2:
            known |= {33421: (33421, "H", 2, (2, 2)), 33422: (33422, "B", 4, (0, 1, 1, 2))}
        known |= {tag[0]: tag for tag in tags}
        extra = [(*known[number], True) for number in sorted(known)]
        kind = "cfa" if values.ndim == 2 else "linear_raw"
        options = {"photometric": kind, "software": False, **options}
        return tiff_file(values, extratags=extra, **options)

    return write

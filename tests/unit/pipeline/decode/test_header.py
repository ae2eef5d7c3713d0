from __future__ import annotations

import io
from collections.abc import Callable
from typing import Any

import numpy as np
import pillow_heif
import pytest
from numpy.typing import NDArray
from PIL import Image as PillowImage

from pipeline.decode import Header, decode, read_alike, read_header
from pipeline.decode.samples import inverse, upright

Codes = NDArray[np.uint8]
Write = Callable[..., bytes]


@pytest.mark.parametrize("orientation", range(1, 9))
def test_a_turn_is_taken_back_by_its_inverse(codes: Codes, orientation: int) -> None:
    turned = upright(codes, orientation)
    np.testing.assert_array_equal(upright(turned, inverse(orientation)), codes)


@pytest.mark.parametrize(
    ("flash", "expected"),
    [
        (Header("JPEG", (40, 60), 6), Header("JPEG", (60, 40), 1)),
        (Header("JPEG", (60, 40), 3), Header("JPEG", (60, 40), 1)),
        (Header("JPEG", (60, 40), 1), Header("JPEG", (60, 40), 1)),
        (Header("JPEG", (60, 40), 6), Header("JPEG", (60, 40), 6)),
        (Header("TIFF", (60, 40), 3), Header("TIFF", (60, 40), 3)),
        (Header("JPEG", (50, 40), 3), Header("JPEG", (50, 40), 3)),
    ],
)
def test_a_pair_of_one_kind_and_size_of_sensor_is_read_alike(
    flash: Header, expected: Header
) -> None:
    """A converter that has turned one of the two has changed its size or kind."""
    assert read_alike(Header("JPEG", (60, 40), 1), flash) == expected


@pytest.fixture
def file_of(
    codes: Codes,
    exif_of: Callable[..., PillowImage.Exif],
    pillow_file: Write,
    tiff_file: Write,
    dng_file: Write,
) -> Callable[[str, int], bytes]:
    """Write one and the same picture of 64 × 48 pixels in any kind and orientation."""

    def write(kind: str, orientation: int) -> bytes:
        exif = exif_of({274: orientation}, {})
        file = io.BytesIO()
        if kind == "DNG":
            mosaic = 600 + 50 * codes[..., 0].astype(np.uint16)
            return dng_file(mosaic, more=((274, "H", 1, orientation),))
        if kind == "linear DNG":
            tags: list[Any] = [(50706, "B", 4, (1, 4, 0, 0), True)]
            tags += [(274, "H", 1, orientation, True)]
            values = codes.astype(np.uint16) * 257
            return tiff_file(values, photometric="linear_raw", extratags=tags)
        if kind == "HEIF":
            written = pillow_heif.from_bytes("RGB", (64, 48), codes.tobytes())
            written.save(file, quality=-1, chroma=444, exif=exif.tobytes())
            return file.getvalue()
        quality = {"quality": 98, "subsampling": 0} if kind == "JPEG" else {}
        return pillow_file(codes, kind, exif=exif, **quality)

    return write


@pytest.mark.parametrize("kind", ["JPEG", "PNG", "TIFF", "HEIF", "DNG", "linear DNG"])
@pytest.mark.parametrize(("own", "other"), [(6, 1), (1, 6), (3, 1), (8, 6), (5, 3), (1, 7)])
def test_a_file_is_turned_as_it_is_told(
    file_of: Callable[[str, int], bytes], kind: str, own: int, other: int
) -> None:
    """Its pixels are those of a file that says the other orientation itself."""
    data, like = file_of(kind, own), file_of(kind, other)
    header = read_header(data)

    frame, expected = decode(data, orientation=other), decode(like)

    assert (header.orientation, header.stored) == (own, (64, 48))
    assert header.size == ((48, 64) if own >= 5 else (64, 48))
    assert (frame.orientation, frame.written_orientation) == (other, own)
    assert (expected.orientation, expected.written_orientation) == (other, other)
    assert frame.size == expected.size
    # libheif codes a picture that it turns itself a little otherwise
    atol = 0.02 if kind == "HEIF" else 0.0
    np.testing.assert_allclose(frame.pixels[:], expected.pixels[:], rtol=0, atol=atol)
    np.testing.assert_array_equal(frame.saturated, expected.saturated)

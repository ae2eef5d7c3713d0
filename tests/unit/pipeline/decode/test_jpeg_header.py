"""JPEGs with an odd header are read where they are sound, and refused where they are damaged."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import imagecodecs
import numpy as np
import pytest
import simplejpeg
from numpy.typing import NDArray

from pipeline.decode import decode
from pipeline.decode.jpeg_header import (
    exif_block,
    frame,
    frame_pixels,
    is_whole_header,
    plain_header,
)
from pipeline.errors import UnreadableImageError

Codes = NDArray[np.uint8]
Write = Callable[..., bytes]


def with_odd_scan(data: bytes) -> bytes:
    """As Samsung's phones write it: Se is 0."""
    scan = data.index(b"\xff\xda")
    end = scan + 2 + int.from_bytes(data[scan + 2 : scan + 4], "big")
    return data[: end - 2] + b"\0" + data[end - 1 :]


def with_odd_jfif(data: bytes) -> bytes:
    return data.replace(b"JFIF\0\1", b"JFIF\0\2", 1)


def with_odd_adobe(data: bytes) -> bytes:
    """In place of JFIF, beside which libjpeg does not look at it."""
    return data[:2] + b"\xff\xee\0\x0eAdobe\0\x64\0\0\0\0\5" + data[20:]


ODD = pytest.mark.parametrize("odd", [with_odd_scan, with_odd_jfif, with_odd_adobe])


@ODD
@pytest.mark.parametrize("stray", [b"", b"\0\x11\x22"], ids=["", "stray bytes"])
def test_an_odd_header_changes_no_pixel(
    codes: Codes, pillow_file: Write, odd: Callable[[bytes], bytes], stray: bytes
) -> None:
    data = pillow_file(codes, "JPEG")
    changed = odd(data)
    with pytest.raises(ValueError, match=r"SOS|JFIF|Adobe"):
        simplejpeg.decode_jpeg(changed, "RGB", strict=True)

    frame = decode(changed[:-2] + stray + changed[-2:])

    np.testing.assert_array_equal(frame.pixels, decode(data).pixels)


@ODD
def test_damage_behind_an_odd_header_is_refused(
    pillow_file: Write, odd: Callable[[bytes], bytes]
) -> None:
    noise = np.random.default_rng(1).integers(0, 255, (64, 96, 3), dtype=np.uint8)
    data = odd(pillow_file(noise, "JPEG"))
    middle = len(data) // 2

    for damaged in (data[:middle], data[:middle] + bytes(400) + data[middle + 400 :]):
        with pytest.raises(UnreadableImageError, match="damaged"):
            decode(damaged)


@pytest.mark.parametrize("lost", [1, 2])
@pytest.mark.parametrize("options", [{}, {"keep_rgb": True}, {"restart_marker_rows": 1}])
def test_without_its_end_marker_a_whole_picture_is_read(
    codes: Codes, pillow_file: Write, options: dict[str, bool], lost: int
) -> None:
    data = pillow_file(codes, "JPEG", **options)

    frame = decode(data[:-lost])

    np.testing.assert_array_equal(frame.pixels, decode(data).pixels)


def test_a_picture_that_lacks_more_than_its_end_marker_is_refused(
    codes: Codes, pillow_file: Write
) -> None:
    data = pillow_file(codes, "JPEG")
    progressive = pillow_file(codes, "JPEG", progressive=True)
    without_a_scan = progressive[: progressive.rindex(b"\xff\xc4")]

    for damaged in (data[:-3], data[:-4], data[:-30], progressive[:-2], without_a_scan):
        with pytest.raises(UnreadableImageError, match="damaged or incomplete JPEG"):
            decode(damaged)


@pytest.mark.parametrize("options", [{}, {"progressive": True}, {"keep_rgb": True}])
def test_a_plain_header_stays_as_it_is(
    codes: Codes, pillow_file: Write, options: dict[str, bool]
) -> None:
    data = pillow_file(codes, "JPEG", **options)

    assert plain_header(data) == data


def test_a_header_cut_off_anywhere_stays_as_it_is(codes: Codes, pillow_file: Write) -> None:
    data = pillow_file(codes, "JPEG")

    for end in range(data.index(b"\xff\xda") + 20):
        assert plain_header(data[:end]) == data[:end]
    for segment in (
        b"\xff\xe0\0\7JFIF\0",
        b"\xff\xee\0\7Adobe",
        b"\xff\xc0\0\3\0\xff\xda\0\5\0\0\0",
    ):
        assert plain_header(b"\xff\xd8" + segment) == b"\xff\xd8" + segment


def test_a_frame_tells_its_process_and_components(codes: Codes, pillow_file: Write) -> None:
    grey = np.ascontiguousarray(codes[..., 0].astype(np.uint16))

    assert frame(pillow_file(codes, "JPEG")) == (0xC0, 3)
    assert frame(pillow_file(codes, "JPEG", progressive=True)) == (0xC2, 3)
    assert frame(bytes(imagecodecs.ljpeg_encode(grey))) == (0xC3, 1)
    assert frame(b"") is None
    assert frame(pillow_file(codes, "JPEG")[:20]) is None


def test_a_frame_tells_its_size(codes: Codes, pillow_file: Write) -> None:
    assert frame_pixels(pillow_file(codes, "JPEG")) == 64 * 48
    assert frame_pixels(bytes(imagecodecs.ljpeg_encode(codes[:, :10, 0].astype(np.uint16)))) == 480
    assert frame_pixels(b"") == 0
    assert frame_pixels(b"\xff\xd8\xff\xc0\0\4") == 0


@pytest.mark.parametrize("between", [b"\xff\xfe\0\2", b"\xff\xff"], ids=["comment", "fill"])
def test_an_empty_comment_and_fill_bytes_hide_nothing_that_comes_after(
    codes: Codes, pillow_file: Write, exif_of: Callable[..., Any], between: bytes
) -> None:
    data = pillow_file(codes, "JPEG", exif=exif_of({271: "Maker", 274: 6}, {34855: 400}))
    changed = data[:2] + between + data[2:]

    assert exif_block(changed) == exif_block(data) != b""
    assert frame(changed) == (0xC0, 3)
    assert is_whole_header(changed)
    found = decode(changed)
    assert (found.make, found.exposure.iso, found.size) == ("Maker", 400, (48, 64))
    np.testing.assert_array_equal(decode(changed[:-2]).pixels, decode(data).pixels)


def test_an_empty_frame_and_an_empty_scan_tell_nothing() -> None:
    for data in (b"\xff\xd8\xff\xc0\0\2", b"\xff\xd8\xff\xc0\0\2\xff\xda\0\2"):
        assert frame(data) is None
        assert not is_whole_header(data)
        assert plain_header(data) == data

"""What the chunks of a PNG say of its colours."""

from __future__ import annotations

import struct
import zlib
from typing import Any

import imagecodecs
import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.arrays import Floats64
from pipeline.colour.icc import linear_rec2020_profile, srgb_profile
from pipeline.decode import decode, read_header
from pipeline.decode.png_colours import png_profile
from pipeline.errors import UnreadableImageError

P3_TO_SRGB = np.array([[1.2249, -0.2247, 0.0], [-0.0420, 1.0419, 0.0], [-0.0197, -0.0786, 1.0979]])
"""Linear Display P3 → linear sRGB; CSS Color Module 4, sample code."""
SRGB_TO_REC2020 = np.array(
    [[0.6274, 0.3293, 0.0433], [0.0691, 0.9195, 0.0114], [0.0164, 0.0880, 0.8956]]
)
"""Linear light, Rec. ITU-R BT.2087-0."""
SRGB, GAMMA, LINEAR = (b"sRGB", b"\0"), (b"gAMA", 45455), (b"gAMA", 100_000)

Codes = NDArray[np.unsignedinteger[Any]]


def png(values: Codes, *chunks: tuple[bytes, bytes | int]) -> bytes:
    """Write a picture with chunks after its header."""
    data = bytes(imagecodecs.png_encode(values))
    packed = b""
    for name, content in chunks:
        body = struct.pack(">I", content) if isinstance(content, int) else content
        packed += struct.pack(">I", len(body)) + name + body
        packed += struct.pack(">I", zlib.crc32(name + body))
    return data[:33] + packed + data[33:]


def icc(profile: bytes) -> tuple[bytes, bytes]:
    return b"iCCP", b"name\0\0" + zlib.compress(profile)


def cicp(primaries: int, transfer: int, full_range: int = 1) -> tuple[bytes, bytes]:
    return b"cICP", bytes([primaries, transfer, 0, full_range])


def chrm(
    *red_green_blue: float, white: tuple[float, float] = (0.3127, 0.3290)
) -> tuple[bytes, bytes]:
    return b"cHRM", struct.pack(">8I", *(round(n * 100_000) for n in (*white, *red_green_blue)))


SRGB_XY = chrm(0.64, 0.33, 0.30, 0.60, 0.15, 0.06)
P3_XY = chrm(0.680, 0.320, 0.265, 0.690, 0.150, 0.060)


def linear(codes: NDArray[np.uint8]) -> Floats64:
    value = codes / 255.0
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


@pytest.fixture(params=[np.uint8, np.uint16], ids=["8 bits", "16 bits"])
def values(request: pytest.FixtureRequest, codes: NDArray[np.uint8]) -> Codes:
    return codes if request.param is np.uint8 else codes.astype(np.uint16) * 257


@pytest.mark.parametrize(
    "chunk",
    [SRGB, GAMMA, (b"gAMA", 45000), cicp(1, 13), cicp(1, 1)],
    ids=["sRGB", "gamma", "gamma, rounded", "cICP", "cICP of video"],
)
def test_srgb_is_taken_as_such_in_any_depth(
    codes: NDArray[np.uint8], values: Codes, chunk: tuple[bytes, bytes]
) -> None:
    frame = decode(png(values, chunk))

    assert frame.encoding == "srgb"
    np.testing.assert_allclose(frame.pixels[:], linear(codes), atol=1e-4)


@pytest.mark.parametrize("chunk", [LINEAR, cicp(1, 8)], ids=["gamma", "cICP"])
def test_linear_values_stay_in_any_depth(
    codes: NDArray[np.uint8], values: Codes, chunk: tuple[bytes, bytes]
) -> None:
    frame = decode(png(values, chunk))

    assert (frame.encoding, frame.profiled) == ("linear", True)
    np.testing.assert_allclose(frame.pixels[:], codes / 255, atol=1e-4)


def test_the_primaries_of_code_points_become_those_of_srgb(
    codes: NDArray[np.uint8], values: Codes
) -> None:
    p3 = decode(png(values, cicp(12, 13))).pixels[:]
    wide = decode(png(values, cicp(9, 13))).pixels[:]

    np.testing.assert_allclose(p3, linear(codes) @ P3_TO_SRGB.T, atol=0.001)
    np.testing.assert_allclose(wide @ SRGB_TO_REC2020.T, linear(codes), atol=0.001)


@pytest.mark.parametrize("transfer", [16, 18])
@pytest.mark.parametrize("encoding", ["auto", "linear"])
def test_hdr_is_refused(values: Codes, transfer: int, encoding: str) -> None:
    data = png(values, cicp(9, transfer))

    with pytest.raises(UnreadableImageError, match="HDR picture"):
        read_header(data)
    with pytest.raises(UnreadableImageError, match="HDR picture"):
        decode(data, encoding)


@pytest.mark.parametrize(
    ("chunks", "expected"),
    [
        ((icc(linear_rec2020_profile()), GAMMA), linear_rec2020_profile()),
        ((SRGB, LINEAR), srgb_profile()),
        ((icc(linear_rec2020_profile()), cicp(1, 2)), linear_rec2020_profile()),
        (((b"cICP", b"\1"), SRGB), srgb_profile()),
        ((icc(linear_rec2020_profile()), GAMMA, P3_XY), linear_rec2020_profile()),
        ((SRGB, P3_XY), srgb_profile()),
        (((b"iCCP", b"name"), SRGB), srgb_profile()),
        (((b"gAMA", 0),), None),
        (((b"gAMA", 5_000_000),), None),
        ((chrm(0.3, 0.3, 0.3, 0.3, 0.3, 0.3),), None),
        (((b"cHRM", b"short"),), None),
        ((), None),
    ],
    ids=[
        "profile, gamma",
        "sRGB, gamma",
        "unspecified",
        "broken",
        "profile, primaries",
        "sRGB, primaries",
        "broken profile, sRGB",
        "gamma 0",
        "gamma 50",
        "primaries in a point",
        "broken primaries",
        "nothing",
    ],
)
def test_what_says_more_goes_first(
    codes: NDArray[np.uint8],
    chunks: tuple[tuple[bytes, bytes | int], ...],
    expected: bytes | None,
) -> None:
    assert png_profile(png(codes, *chunks)) == expected


def test_a_profile_of_more_than_a_million_bytes_counts(codes: NDArray[np.uint8]) -> None:
    """Such as those of displays, with a table for their colours, that editors may embed."""
    profile = srgb_profile()
    profile += np.random.default_rng(0).bytes(2_000_000)  # beside its tags
    profile = struct.pack(">I", len(profile)) + profile[4:]

    frame = decode(png(codes.astype(np.uint16) * 257, icc(profile)))

    np.testing.assert_allclose(frame.pixels[:], linear(codes), atol=0.001)
    assert frame.encoding == "srgb"


BROKEN = [
    (b"iCCP", b"name\0\0" + zlib.compress(srgb_profile())[:-20]),
    (b"iCCP", b"name\0\0no deflated bytes"),
    (b"iCCP", b"name"),
    icc(b""),
    icc(bytes(2**24 + 1)),
]


@pytest.mark.parametrize("chunk", BROKEN, ids=["cut off", "other", "no", "empty", "too much"])
def test_16_bits_with_a_damaged_profile_are_refused(
    codes: NDArray[np.uint8], chunk: tuple[bytes, bytes]
) -> None:
    """Whoever gave them one has most likely bent them; those of 8 bits are sRGB."""
    with pytest.raises(UnreadableImageError, match="colour profile that cannot be read"):
        decode(png(codes.astype(np.uint16) * 257, chunk))

    frame = decode(png(codes, chunk))
    np.testing.assert_allclose(frame.pixels[:], linear(codes), atol=1e-6)


@pytest.mark.parametrize("gamma", [55_555, 30_000])
def test_any_gamma_is_a_power(codes: NDArray[np.uint8], values: Codes, gamma: int) -> None:
    """1/1.8 is that of old Macs."""
    frame = decode(png(values, (b"gAMA", gamma)))

    np.testing.assert_allclose(frame.pixels[:], (codes / 255) ** (100_000 / gamma), atol=0.002)
    assert frame.encoding == "srgb"


def test_primaries_become_those_of_srgb(codes: NDArray[np.uint8], values: Codes) -> None:
    """With 1/2.2 by a power: only in the colours of sRGB that stands for its curve."""
    bent = decode(png(values, GAMMA, P3_XY)).pixels[:]
    straight = decode(png(values, LINEAR, P3_XY)).pixels[:]
    srgb = decode(png(values, GAMMA, SRGB_XY)).pixels[:]

    np.testing.assert_allclose(bent, (codes / 255) ** 2.2 @ P3_TO_SRGB.T, atol=0.002)
    np.testing.assert_allclose(straight, codes / 255 @ P3_TO_SRGB.T, atol=0.001)
    np.testing.assert_allclose(srgb, linear(codes), atol=1e-4)


def test_primaries_alone_leave_the_curve_of_the_depth(codes: NDArray[np.uint8]) -> None:
    small = decode(png(codes, P3_XY)).pixels[:]
    large = decode(png(codes.astype(np.uint16) * 257, P3_XY)).pixels[:]

    np.testing.assert_allclose(small, linear(codes) @ P3_TO_SRGB.T, atol=0.001)
    np.testing.assert_allclose(large, codes / 255 @ P3_TO_SRGB.T, atol=0.001)


def test_a_white_that_is_not_d65_becomes_white(codes: NDArray[np.uint8]) -> None:
    d50 = chrm(0.64, 0.33, 0.30, 0.60, 0.15, 0.06, white=(0.3457, 0.3585))
    grey = np.full_like(codes, 128)

    pixels = decode(png(grey, GAMMA, d50)).pixels[:]

    np.testing.assert_allclose(pixels, (128 / 255) ** 2.2, atol=0.002)


@pytest.mark.parametrize("encoding", ["auto", "linear"])
def test_the_limited_range_of_video_is_refused(values: Codes, encoding: str) -> None:
    data = png(values, cicp(1, 13, full_range=0))

    with pytest.raises(UnreadableImageError, match="limited range of video"):
        read_header(data)
    with pytest.raises(UnreadableImageError, match="limited range of video"):
        decode(data, encoding)


def test_code_points_go_before_a_profile(codes: NDArray[np.uint8]) -> None:
    data = png(codes, icc(linear_rec2020_profile()), cicp(1, 13))

    np.testing.assert_allclose(decode(data).pixels[:], linear(codes), atol=1e-4)


def test_the_encoding_overrides_the_chunks(codes: NDArray[np.uint8]) -> None:
    wide = codes.astype(np.uint16) * 257

    told_linear, told_srgb = decode(png(wide, SRGB), "linear"), decode(png(wide, LINEAR), "srgb")

    np.testing.assert_allclose(told_linear.pixels[:], codes / 255, atol=1e-6)
    np.testing.assert_allclose(told_srgb.pixels[:], linear(codes), atol=1e-6)


@pytest.mark.parametrize("end", [8, 20, 33, 37, 45])
def test_a_file_cut_off_says_what_it_still_has(codes: NDArray[np.uint8], end: int) -> None:
    expected = srgb_profile() if end == 45 else None

    assert png_profile(png(codes, SRGB)[:end]) == expected

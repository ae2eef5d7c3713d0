"""Colours of files that are not in sRGB."""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Callable
from typing import Any

import imagecodecs
import numpy as np
import pillow_heif
import pytest
import tifffile
from numpy.typing import NDArray
from PIL import Image as PillowImage
from PIL import ImageCms

from pipeline.arrays import Floats32, Floats64
from pipeline.colour.icc import (
    adobe_rgb_profile,
    linear_rec2020_profile,
    matrix_profile,
    srgb_profile,
)
from pipeline.colour.spaces import SRGB_PRIMARIES, Primaries
from pipeline.decode import decode, profiles
from pipeline.decode.profiles import (
    differs_from_srgb,
    embedded_profile,
    is_curved,
    is_straight,
    profile_to_linear,
    to_linear_srgb,
)
from pipeline.errors import UnreadableImageError

P3 = ((0.680, 0.320), (0.265, 0.690), (0.150, 0.060))
P3_TO_SRGB = np.array([[1.2249, -0.2247, 0.0], [-0.0420, 1.0419, 0.0], [-0.0197, -0.0786, 1.0979]])
"""Linear Display P3 → linear sRGB; CSS Color Module 4, sample code."""


@pytest.fixture
def p3() -> bytes:
    return matrix_profile("P3", P3, "srgb")


def linear(codes: NDArray[Any]) -> Floats64:
    value = codes / 255.0
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


@pytest.mark.parametrize("kind", ["PNG", "TIFF", "JPEG"])
def test_display_p3_becomes_linear_srgb(
    codes: NDArray[np.uint8], pillow_file: Callable[..., bytes], p3: bytes, kind: str
) -> None:
    quality = {"quality": 100, "subsampling": 0} if kind == "JPEG" else {}
    frame = decode(pillow_file(codes, kind, icc_profile=p3, **quality))

    tolerance = 0.02 if kind == "JPEG" else 0.001
    np.testing.assert_allclose(frame.pixels, linear(codes) @ P3_TO_SRGB.T, atol=tolerance)
    assert frame.encoding == "srgb"


def test_profiles_of_pictures_too_large_for_pillow_are_read(
    codes: NDArray[np.uint8],
    pillow_file: Callable[..., bytes],
    p3: bytes,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Its limit of 179 million pixels is below ours."""
    data = pillow_file(codes, "JPEG", icc_profile=p3)
    monkeypatch.setattr(PillowImage, "MAX_IMAGE_PIXELS", codes.shape[0] * codes.shape[1] // 3)

    assert embedded_profile(data) == p3


def test_a_file_without_a_profile_or_a_header_has_none(
    codes: NDArray[np.uint8], pillow_file: Callable[..., bytes]
) -> None:
    data = pillow_file(codes, "JPEG")

    assert embedded_profile(data) is None
    assert embedded_profile(data[:20]) is None
    assert embedded_profile(b"") is None


def test_colours_outside_srgb_keep_their_negative_parts(
    pillow_file: Callable[..., bytes], p3: bytes
) -> None:
    green = np.full((16, 16, 3), (0, 255, 0), np.uint8)

    frame = decode(pillow_file(green, "PNG", icc_profile=p3))

    np.testing.assert_allclose(frame.pixels[5, 5], [-0.2247, 1.0419, -0.0786], atol=0.001)
    assert frame.saturated.all()


def test_heif_with_p3_primaries_and_no_profile(codes: NDArray[np.uint8]) -> None:
    file = io.BytesIO()
    image = pillow_heif.from_bytes("RGB", (64, 48), codes.tobytes())
    image.save(file, quality=100, chroma=444, color_primaries=12, transfer_characteristics=13)

    frame = decode(file.getvalue())

    np.testing.assert_allclose(frame.pixels, linear(codes) @ P3_TO_SRGB.T, atol=0.03)


def test_heif_with_a_p3_profile(codes: NDArray[np.uint8], p3: bytes) -> None:
    pillow_heif.register_heif_opener()
    file = io.BytesIO()
    PillowImage.fromarray(codes).save(file, "HEIF", quality=100, chroma=444, icc_profile=p3)

    frame = decode(file.getvalue())

    np.testing.assert_allclose(frame.pixels, linear(codes) @ P3_TO_SRGB.T, atol=0.03)


ADOBE_TO_SRGB = np.array([[1.3984, -0.3984, 0.0], [0.0, 1.0, 0.0], [0.0, -0.0429, 1.0429]])
"""Linear Adobe RGB (1998) → linear sRGB, from the matrices to XYZ of both standards."""


@pytest.mark.parametrize(
    ("color_space", "index", "adobe"),
    [(0xFFFF, "R03", True), (0xFFFF, "R98", False), (0xFFFF, None, False), (2, None, True)],
)
def test_jpeg_of_a_camera_set_to_adobe_rgb_tells_so_by_exif(
    codes: NDArray[np.uint8],
    pillow_file: Callable[..., bytes],
    exif_of: Callable[..., PillowImage.Exif],
    color_space: int,
    index: str | None,
    adobe: bool,
) -> None:
    interoperability = {} if index is None else {0xA005: {1: index}}
    exif = exif_of({}, {0xA001: color_space, **interoperability})

    frame = decode(pillow_file(codes, "JPEG", exif=exif, quality=100, subsampling=0))

    light = (codes / 255) ** (563 / 256) @ ADOBE_TO_SRGB.T
    np.testing.assert_allclose(frame.pixels, light if adobe else linear(codes), atol=0.02)


def test_a_profile_goes_before_what_exif_says(
    codes: NDArray[np.uint8],
    pillow_file: Callable[..., bytes],
    exif_of: Callable[..., PillowImage.Exif],
) -> None:
    exif = exif_of({}, {0xA001: 0xFFFF, 0xA005: {1: "R03"}})
    data = pillow_file(codes, "JPEG", exif=exif, icc_profile=srgb_profile())

    np.testing.assert_array_equal(decode(data).pixels, decode(pillow_file(codes, "JPEG")).pixels)


def test_other_peoples_srgb_profile_changes_nothing(
    codes: NDArray[np.uint8], pillow_file: Callable[..., bytes]
) -> None:
    foreign = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()

    with_profile = decode(pillow_file(codes, "PNG", icc_profile=foreign))

    np.testing.assert_array_equal(with_profile.pixels, decode(pillow_file(codes, "PNG")).pixels)


def test_being_told_the_encoding_overrides_the_profile(
    codes: NDArray[np.uint8], pillow_file: Callable[..., bytes], p3: bytes
) -> None:
    data = pillow_file(codes, "PNG", icc_profile=p3)

    np.testing.assert_allclose(decode(data, "srgb").pixels, linear(codes), atol=1e-6)
    np.testing.assert_allclose(decode(data, "linear").pixels, codes / 255.0, atol=1e-6)


def test_turned_pictures_keep_their_colours(
    codes: NDArray[np.uint8],
    pillow_file: Callable[..., bytes],
    exif_of: Callable[..., PillowImage.Exif],
    p3: bytes,
) -> None:
    data = pillow_file(codes, "PNG", icc_profile=p3, exif=exif_of({274: 6}, {}))

    expected = np.rot90(linear(codes), -1) @ P3_TO_SRGB.T

    np.testing.assert_allclose(decode(data).pixels, expected, atol=0.001)


@pytest.mark.parametrize(
    ("profile", "differs"),
    [
        (srgb_profile(), False),
        (linear_rec2020_profile(), True),
        (matrix_profile("P3", P3, "srgb"), True),
        (b"no profile at all", False),
        (b"", False),
        (srgb_profile()[:200], False),
        (ImageCms.ImageCmsProfile(ImageCms.createProfile("LAB")).tobytes(), False),
    ],
    ids=["sRGB", "Rec. 2020", "P3", "text", "empty", "cut off", "Lab"],
)
def test_only_profiles_of_other_colours_differ(profile: bytes, differs: bool) -> None:
    assert differs_from_srgb(profile) is differs


def test_a_broken_profile_counts_as_none(
    codes: NDArray[np.uint8], pillow_file: Callable[..., bytes]
) -> None:
    frame = decode(pillow_file(codes, "PNG", icc_profile=b"\x00" * 64))

    np.testing.assert_allclose(frame.pixels, linear(codes), atol=1e-6)


ADOBE = ((0.64, 0.33), (0.21, 0.71), (0.15, 0.06))


def sixteen_bits(values: NDArray[np.uint16], kind: str, profile: bytes) -> bytes:
    if kind == "PNG":
        data = bytes(imagecodecs.png_encode(values))
        chunk = b"iCCPname\0\0" + zlib.compress(profile)
        chunk = struct.pack(">I", len(chunk) - 4) + chunk + struct.pack(">I", zlib.crc32(chunk))
        return data[:33] + chunk + data[33:]  # after the header
    file = io.BytesIO()
    order: Any = ">" if kind == "big-endian TIFF" else "<"
    tifffile.imwrite(file, values, photometric="rgb", iccprofile=profile, byteorder=order)
    return file.getvalue()


@pytest.mark.parametrize("kind", ["TIFF", "big-endian TIFF", "PNG"])
@pytest.mark.parametrize(
    ("primaries", "to_srgb"), [(SRGB_PRIMARIES, np.eye(3)), (P3, P3_TO_SRGB)], ids=["sRGB", "P3"]
)
def test_16_bits_follow_a_profile_that_is_not_linear(
    codes: NDArray[np.uint8], kind: str, primaries: Primaries, to_srgb: Floats64
) -> None:
    """As programs that develop RAW files export them."""
    profile = matrix_profile("exported", primaries, "srgb")

    frame = decode(sixteen_bits(codes.astype(np.uint16) * 257, kind, profile))

    np.testing.assert_allclose(frame.pixels, linear(codes) @ to_srgb.T, atol=0.001)
    assert frame.encoding == "srgb"


@pytest.mark.parametrize("kind", ["TIFF", "PNG"])
@pytest.mark.parametrize(
    ("profile", "encoding"),
    [
        (linear_rec2020_profile(), "linear"),
        (b"no profile at all" * 10, "linear"),
        (srgb_profile(), "linear"),
        (matrix_profile("P3", P3, "srgb"), "linear"),
    ],
    ids=["told, Rec. 2020", "told, no profile", "told, sRGB", "told, P3"],
)
def test_16_bits_stay_as_they_are_where_told(
    codes: NDArray[np.uint8], kind: str, profile: bytes, encoding: str
) -> None:
    frame = decode(sixteen_bits(codes.astype(np.uint16) * 257, kind, profile), encoding)

    np.testing.assert_allclose(frame.pixels, codes / 255, atol=1e-6)
    assert (frame.encoding, frame.profiled) == ("linear", False)


@pytest.mark.parametrize("kind", ["TIFF", "big-endian TIFF", "PNG"])
@pytest.mark.parametrize(
    ("primaries", "to_srgb"), [(SRGB_PRIMARIES, np.eye(3)), (P3, P3_TO_SRGB)], ids=["sRGB", "P3"]
)
def test_16_bits_of_a_linear_profile_become_linear_srgb(
    codes: NDArray[np.uint8], kind: str, primaries: Primaries, to_srgb: Floats64
) -> None:
    """As programs that develop RAW files write them for further work."""
    profile = matrix_profile("linear", primaries, "linear")

    frame = decode(sixteen_bits(codes.astype(np.uint16) * 257, kind, profile))

    np.testing.assert_allclose(frame.pixels, codes / 255 @ to_srgb.T, atol=0.001)
    assert (frame.encoding, frame.profiled) == ("linear", True)


def floats(values: NDArray[np.floating[Any]], profile: bytes) -> bytes:
    file = io.BytesIO()
    tifffile.imwrite(file, values, photometric="rgb", iccprofile=profile)
    return file.getvalue()


@pytest.mark.parametrize("kind", [np.float16, np.float32])
@pytest.mark.parametrize(
    ("primaries", "to_srgb"), [(SRGB_PRIMARIES, np.eye(3)), (P3, P3_TO_SRGB)], ids=["sRGB", "P3"]
)
def test_floats_of_a_linear_profile_become_linear_srgb(
    codes: NDArray[np.uint8],
    kind: type[np.floating[Any]],
    primaries: Primaries,
    to_srgb: Floats64,
) -> None:
    """Also those above white and below black."""
    values = (codes / 255 * 3 - 0.1).astype(kind)

    frame = decode(floats(values, matrix_profile("linear", primaries, "linear")))

    np.testing.assert_allclose(frame.pixels, values.astype(float) @ to_srgb.T, atol=0.003)
    assert (frame.encoding, frame.profiled) == ("linear", True)
    assert not frame.saturated.any()


@pytest.mark.parametrize(
    ("primaries", "to_srgb"), [(SRGB_PRIMARIES, np.eye(3)), (P3, P3_TO_SRGB)], ids=["sRGB", "P3"]
)
def test_floats_follow_a_profile_that_is_not_linear(
    codes: NDArray[np.uint8], primaries: Primaries, to_srgb: Floats64
) -> None:
    profile = matrix_profile("exported", primaries, "srgb")

    frame = decode(floats((codes / 255).astype(np.float32), profile))

    np.testing.assert_allclose(frame.pixels, linear(codes) @ to_srgb.T, atol=0.001)
    assert (frame.encoding, frame.profiled) == ("srgb", False)


@pytest.mark.parametrize(
    ("profile", "encoding"),
    [(matrix_profile("P3", P3, "srgb"), "linear"), (b"no profile at all" * 10, "linear")],
    ids=["told, P3", "told, no profile"],
)
def test_floats_stay_as_they_are_where_told(
    codes: NDArray[np.uint8], profile: bytes, encoding: str
) -> None:
    values = (codes / 255).astype(np.float32)

    frame = decode(floats(values, profile), encoding)

    np.testing.assert_array_equal(frame.pixels, values)
    assert (frame.encoding, frame.profiled) == ("linear", False)


@pytest.mark.parametrize(
    "profile",
    [
        b"no profile at all" * 10,
        srgb_profile()[:300],
        ImageCms.ImageCmsProfile(ImageCms.createProfile("LAB")).tobytes(),
    ],
    ids=["text", "cut off", "Lab"],
)
def test_more_than_8_bits_with_a_profile_of_no_use_are_refused(
    codes: NDArray[np.uint8], profile: bytes
) -> None:
    """They are hardly linear, as those without a profile are taken to be."""
    values = codes.astype(np.uint16) * 257
    files = [sixteen_bits(values, kind, profile) for kind in ("TIFF", "PNG")]

    for data in (*files, floats((codes / 255).astype(np.float32), profile)):
        with pytest.raises(UnreadableImageError, match="a colour profile that cannot be read"):
            decode(data)
        assert decode(data, "srgb").encoding == "srgb"


def test_floats_above_white_follow_a_curve_that_goes_on_and_are_refused_where_it_ends() -> None:
    values = np.full((16, 16, 3), 2, np.float32)

    frame = decode(floats(values, adobe_rgb_profile()))

    np.testing.assert_allclose(frame.pixels, 2**2.19921875, rtol=1e-3)
    with pytest.raises(UnreadableImageError, match=r"above white .* save it anew in linear values"):
        decode(floats(values, matrix_profile("P3", P3, "srgb")))


def test_a_linear_curve_that_is_a_table_goes_on_above_white(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    points = np.linspace(0, 65535, 1024).round().astype(">u2").tobytes()
    table = b"curv" + bytes(4) + struct.pack(">I", 1024) + points
    monkeypatch.setattr("pipeline.colour.icc._linear_curve", lambda: table)
    values = np.full((16, 16, 3), 0.5, np.float32)
    values[8:] = 3

    frame = decode(floats(values, matrix_profile("linear", P3, "linear")))

    np.testing.assert_allclose(frame.pixels, values, atol=0.003)
    assert (frame.encoding, frame.profiled) == ("linear", True)


@pytest.mark.parametrize("worst", [np.nan, np.inf, 1e5])
@pytest.mark.parametrize("profile", [linear_rec2020_profile(), adobe_rgb_profile()])
def test_floats_that_are_no_light_are_refused_with_a_profile_too(
    worst: float, profile: bytes
) -> None:
    values = np.full((16, 16, 3), 0.5, np.float32)
    values[3, 4, 1] = worst
    with pytest.raises(UnreadableImageError, match="no light"):
        decode(floats(values, profile))


@pytest.mark.parametrize("kind", ["PNG", "TIFF"])
def test_8_bits_of_a_linear_profile_are_no_rendering(
    codes: NDArray[np.uint8], pillow_file: Callable[..., bytes], kind: str
) -> None:
    profile = matrix_profile("linear", P3, "linear")

    frame = decode(pillow_file(codes, kind, icc_profile=profile))

    np.testing.assert_allclose(frame.pixels, codes / 255 @ P3_TO_SRGB.T, atol=0.001)
    assert (frame.encoding, frame.profiled) == ("linear", True)


@pytest.mark.parametrize(
    ("profile", "encoding", "limit"),
    [
        (srgb_profile(), "auto", 254 * 257),
        (matrix_profile("P3", P3, "srgb"), "auto", 254 * 257),
        (linear_rec2020_profile(), "auto", 65535),
        (srgb_profile(), "linear", 65535),
    ],
    ids=["sRGB", "P3", "linear", "told"],
)
def test_curved_16_bits_are_clipped_where_8_are(profile: bytes, encoding: str, limit: int) -> None:
    values = np.full((40, 40, 3), 30000, np.uint16)
    values[:, 20:, 1] = limit
    values[:, :20, 1] = limit - 1

    frame = decode(sixteen_bits(values, "TIFF", profile), encoding)

    assert frame.saturated[:, 20:].all()
    assert not frame.saturated[:, :20].any()


def test_the_white_of_12_bits_is_that_of_their_profile() -> None:
    values = np.full((16, 16, 3), 4095, np.uint16)
    values[8:] = 2048
    file = io.BytesIO()
    profile = matrix_profile("P3", P3, "srgb")
    tifffile.imwrite(file, values, photometric="rgb", bitspersample=12, iccprofile=profile)

    frame = decode(file.getvalue())

    np.testing.assert_allclose(frame.pixels[0, 0], 1.0, atol=1e-3)
    np.testing.assert_allclose(frame.pixels[-1, 0], linear(np.array(127.53)), atol=1e-3)
    assert frame.saturated[:8].all()
    assert not frame.saturated[8:].any()


@pytest.mark.parametrize(
    ("profile", "curved", "straight"),
    [
        (srgb_profile(), True, False),
        (matrix_profile("A", ADOBE, "srgb"), True, False),
        (matrix_profile("A", ADOBE, "linear"), False, True),
        (linear_rec2020_profile(), False, True),
        (b"no profile at all", False, False),
        (ImageCms.ImageCmsProfile(ImageCms.createProfile("LAB")).tobytes(), False, False),
    ],
    ids=["sRGB", "Adobe", "linear Adobe", "Rec. 2020", "text", "Lab"],
)
def test_profiles_are_curved_or_linear_or_of_no_use(
    profile: bytes, curved: bool, straight: bool
) -> None:
    assert (is_curved(profile), is_straight(profile)) == (curved, straight)


def test_a_profile_by_which_everything_is_black_is_of_no_use(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(profiles, "profile_to_linear", lambda codes, _: 0 * codes.astype("f4"))

    assert (is_curved(b""), is_straight(b"")) == (False, False)


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
@pytest.mark.parametrize(
    "profile",
    [matrix_profile("P3", P3, "srgb"), matrix_profile("A", ADOBE, "linear")],
    ids=["P3", "Adobe primaries"],
)
def test_tables_give_what_the_colour_management_gives(profile: bytes, kind: type) -> None:
    rng = np.random.default_rng(3)
    values: NDArray[Any] = rng.integers(0, np.iinfo(kind).max + 1, (40, 50, 3)).astype(kind)

    light = to_linear_srgb(profile, values.dtype)(values)

    assert light.dtype == np.float32
    np.testing.assert_allclose(light, profile_to_linear(values, profile), atol=5e-7)


@pytest.mark.parametrize("share", [0.3, 0.0], ids=["mixed", "black"])
def test_profiles_that_are_no_curves_and_matrix_go_through_the_colour_management(
    share: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    def by_hand(codes: NDArray[np.uint8], _: bytes) -> Floats32:
        """What only a table of three dimensions could say."""
        light = codes.astype(np.float32) / 255 * share
        return np.asarray(light * light[..., ::-1])

    monkeypatch.setattr(profiles, "profile_to_linear", by_hand)
    values = np.random.default_rng(3).integers(0, 256, (40, 50, 3), dtype=np.uint8)

    light = to_linear_srgb(b"", values.dtype)(values)

    np.testing.assert_array_equal(light, by_hand(values, b""))


@pytest.mark.parametrize(("gamma", "hdr"), [(2.2, False), (2.6, False), (3.6, True), (6.5, True)])
def test_a_profile_as_dark_as_those_of_hdr_is_refused(
    gamma: float,
    hdr: bool,
    codes: NDArray[np.uint8],
    pillow_file: Callable[..., bytes],
    tiff_file: Callable[..., bytes],
) -> None:
    """Gammas of 3.6 and 6.5 code greys about as HLG and PQ do."""
    profile = matrix_profile("any", P3, gamma)
    deep = tiff_file(codes.astype(np.uint16) * 257, iccprofile=profile)
    for data in (pillow_file(codes, "JPEG", icc_profile=profile), deep):
        assert decode(data, encoding="linear").encoding == "linear"
        if hdr:
            with pytest.raises(UnreadableImageError, match="is an HDR picture"):
                decode(data)
        else:
            assert decode(data).encoding == "srgb"

"""Every format comes in with the right values, whatever its name says."""

from __future__ import annotations

import gc
import hashlib
import io
import sys
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import imagecodecs
import numpy as np
import OpenEXR
import pillow_heif
import pytest
import tifffile
from numpy.typing import NDArray
from PIL import Image as PillowImage
from PIL import ImageOps

from pipeline.arrays import Floats64
from pipeline.decode import decode, read_header
from pipeline.decode.samples import upright
from tests.png_bombs import png_of

Codes = NDArray[np.uint8]
Write = Callable[..., bytes]


def linear(codes: NDArray[Any]) -> Floats64:
    value = codes / 255.0
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


@pytest.mark.parametrize("progressive", [False, True])
def test_jpeg_is_srgb_within_its_own_loss(
    codes: Codes, pillow_file: Write, progressive: bool
) -> None:
    data = pillow_file(codes, "JPEG", quality=98, subsampling=0, progressive=progressive)

    frame = decode(data)

    assert frame.encoding == "srgb"
    assert frame.pixels[:].dtype == np.float32
    assert frame.size == (64, 48)
    assert np.abs(frame.pixels - linear(codes)).max() < 0.02
    assert frame.sha256 == hashlib.sha256(data).hexdigest()


def test_a_jpeg_with_a_few_stray_bytes_at_its_end_is_read(codes: Codes, pillow_file: Write) -> None:
    data = pillow_file(codes, "JPEG")

    stray = decode(data[:-2] + b"\x00\x11\x22" + data[-2:])

    np.testing.assert_array_equal(stray.pixels, decode(data).pixels)


@pytest.mark.parametrize("trailer", [b"", bytes(6000)])
@pytest.mark.parametrize("mode", ["RGB", "RGBA"])
def test_png_of_8_bits_is_srgb_to_the_last_bit(
    codes: Codes, pillow_file: Write, mode: str, trailer: bytes
) -> None:
    frame = decode(pillow_file(codes, "PNG", mode) + trailer)

    assert frame.encoding == "srgb"
    np.testing.assert_allclose(frame.pixels, linear(codes), atol=1e-6)


def test_an_interlaced_png_is_read_in_silence(
    codes: Codes, caplog: pytest.LogCaptureFixture
) -> None:
    """libpng would tell the terminal of it. The passes are those of the PNG specification, 8.2."""
    passes = ((0, 0, 8, 8), (0, 4, 8, 8), (4, 0, 8, 4), (0, 2, 4, 4), (2, 0, 4, 2), (0, 1, 2, 2))
    rows = b"".join(
        b"\0" + row.tobytes()
        for top, left, down, across in (*passes, (1, 0, 2, 1))
        for row in codes[top::down, left::across]
    )
    height, width = codes.shape[:2]

    frame = decode(png_of(width, height, zlib.compress(rows), interlaced=True))

    np.testing.assert_allclose(frame.pixels, linear(codes), atol=1e-6)
    assert caplog.records == []


def test_a_palette_is_looked_up(codes: Codes) -> None:
    file = io.BytesIO()
    palette = PillowImage.fromarray(codes).quantize(32)
    palette.save(file, "PNG")

    frame = decode(file.getvalue())

    np.testing.assert_allclose(frame.pixels, linear(np.asarray(palette.convert("RGB"))), atol=1e-6)


def test_png_of_16_bits_is_linear(codes: Codes) -> None:
    values = codes.astype(np.uint16) * 257

    frame = decode(bytes(imagecodecs.png_encode(values)))

    assert frame.encoding == "linear"
    np.testing.assert_allclose(frame.pixels, codes / 255.0, atol=1e-6)


@pytest.mark.parametrize(
    ("dtype", "encoding"),
    [
        ("u1", "srgb"),
        ("<u2", "linear"),
        (">u2", "linear"),
        ("f2", "linear"),
        ("f4", "linear"),
        ("f8", "linear"),
    ],
)
@pytest.mark.parametrize(
    "layout",
    [
        {},
        {"planarconfig": "separate"},
        {"tile": (16, 16)},
        {"compression": "deflate", "predictor": True},
        {"bigtiff": True},
        {"rowsperstrip": 5},
    ],
    ids=lambda layout: next(iter(layout), "plain"),
)
def test_tiff_of_every_depth_and_layout(
    codes: Codes, tiff_file: Write, dtype: str, encoding: str, layout: dict[str, Any]
) -> None:
    kind = np.dtype(dtype)
    scale = np.iinfo(kind).max if kind.kind == "u" else 1.0
    values = (codes / 255.0 * scale).round(0 if kind.kind == "u" else 6).astype(kind)
    expected = linear(codes) if dtype == "u1" else values.astype(float) / scale
    stored = np.moveaxis(values, -1, 0) if "planarconfig" in layout else values

    frame = decode(tiff_file(stored, byteorder=">" if dtype == ">u2" else "<", **layout))

    assert frame.encoding == encoding
    assert frame.size == (64, 48)
    np.testing.assert_allclose(frame.pixels, expected, atol=1e-6)


def test_tiff_of_12_bits_has_its_own_white(tiff_file: Write) -> None:
    values = np.full((16, 16, 3), 4095, np.uint16)
    values[..., 1] = 1024

    frame = decode(tiff_file(values, bitspersample=12))

    np.testing.assert_allclose(frame.pixels[0, 0], [1.0, 1024 / 4095, 1.0], atol=1e-6)
    assert frame.saturated.all()


def test_jpeg_in_tiff_becomes_rgb(codes: Codes, pillow_file: Write) -> None:
    frame = decode(pillow_file(codes, "TIFF", compression="jpeg", quality=98))

    assert np.abs(frame.pixels - linear(codes)).max() < 0.03


def test_the_first_of_several_pictures_is_taken(codes: Codes, pillow_file: Write) -> None:
    others = [PillowImage.fromarray(255 - codes)]
    for kind in ("TIFF", "PNG"):
        data = pillow_file(codes, kind, save_all=True, append_images=others)
        np.testing.assert_allclose(decode(data).pixels, linear(codes), atol=1e-6)


def test_a_thumbnail_before_the_picture_is_passed_over(codes: Codes) -> None:
    file = io.BytesIO()
    with tifffile.TiffWriter(file) as writer:
        writer.write(codes[::4, ::4], photometric="rgb", subfiletype=1, metadata=None)
        writer.write(codes, photometric="rgb", metadata=None)

    frame = decode(file.getvalue())

    assert read_header(file.getvalue()).size == (64, 48)
    np.testing.assert_allclose(frame.pixels, linear(codes), atol=1e-6)


@pytest.mark.parametrize("first", ["colours", "grey"])
def test_a_small_picture_before_the_large_one_is_passed_over(codes: Codes, first: str) -> None:
    """Of a program that does not call it a thumbnail."""
    file = io.BytesIO()
    small = codes[::4, ::4] if first == "colours" else codes[::4, ::4, 0]
    with tifffile.TiffWriter(file) as writer:
        writer.write(small, photometric="rgb" if small.ndim == 3 else "minisblack", metadata=None)
        writer.write(codes, photometric="rgb", metadata=None)

    assert read_header(file.getvalue()).size == (64, 48)
    np.testing.assert_allclose(decode(file.getvalue()).pixels[:], linear(codes), atol=1e-6)


def test_of_pictures_of_one_size_the_first_in_colours_is_read(codes: Codes) -> None:
    """Some programs put a mask of theirs beside the picture."""
    file = io.BytesIO()
    with tifffile.TiffWriter(file) as writer:
        writer.write(np.repeat(codes[..., 0], 2, axis=0), photometric="minisblack", metadata=None)
        writer.write(codes, photometric="rgb", metadata=None)
        writer.write(codes[::-1], photometric="rgb", metadata=None)

    np.testing.assert_allclose(decode(file.getvalue()).pixels[:], linear(codes), atol=1e-6)


@pytest.mark.parametrize("dtype", [np.float16, np.float32])
def test_exr_is_linear_and_keeps_what_is_negative_or_above_white(
    tmp_path: Path, dtype: type[np.floating[Any]]
) -> None:
    values = np.linspace(-0.25, 4.0, 16 * 24 * 3).reshape(16, 24, 3).astype(dtype)
    path = tmp_path / "picture.txt"
    channels = {name: values[..., i].copy() for i, name in enumerate("RGB")}
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {**channels, "lamp1.R": channels["G"]}).write(str(path))

    frame = decode(path.read_bytes())

    assert frame.encoding == "linear"
    np.testing.assert_array_equal(frame.pixels, values.astype(np.float32))
    assert not frame.saturated.any()


def heif(values: NDArray[Any], **options: Any) -> bytes:
    mode = "RGB" if values.dtype == np.uint8 else "RGB;16"
    file = io.BytesIO()
    image = pillow_heif.from_bytes(mode, (values.shape[1], values.shape[0]), values.tobytes())
    image.save(file, **{"quality": 95, "chroma": 444, **options})
    return file.getvalue()


def test_heif_of_8_bits_is_srgb(codes: Codes) -> None:
    frame = decode(heif(codes))

    assert frame.encoding == "srgb"
    assert np.abs(frame.pixels - linear(codes)).max() < 0.03


@pytest.mark.parametrize("primaries", [1, 2, 9])
def test_heif_that_names_linear_values_is_linear(codes: Codes, primaries: int) -> None:
    file = io.BytesIO()
    told = {"color_primaries": primaries, "transfer_characteristics": 8}
    image = pillow_heif.from_bytes("RGB", (codes.shape[1], codes.shape[0]), codes.tobytes())
    image.save(file, quality=100, chroma=444, **told)

    frame = decode(file.getvalue())

    assert (frame.encoding, frame.profiled) == ("linear", True)
    grey = frame.pixels[:] @ [0.2126, 0.7152, 0.0722]
    weights = [0.2627, 0.6780, 0.0593] if primaries == 9 else [0.2126, 0.7152, 0.0722]
    np.testing.assert_allclose(grey, codes / 255 @ weights, atol=0.02)


def test_heif_of_10_bits_is_srgb_and_its_white_is_1() -> None:
    values = np.full((64, 64, 3), 65535, np.uint16)
    values[32:] = 65535 // 2

    frame = decode(heif(values))

    assert frame.encoding == "srgb"
    np.testing.assert_allclose(frame.pixels[:20], 1.0, atol=0.01)
    np.testing.assert_allclose(frame.pixels[-20:], 0.214, atol=0.01)
    assert frame.saturated[:20].all()
    assert not frame.saturated[-20:].any()


@pytest.mark.parametrize("orientation", range(1, 9))
def test_heif_is_turned_once(
    codes: Codes, exif_of: Callable[..., PillowImage.Exif], orientation: int
) -> None:
    """libheif writes both, EXIF's orientation and the boxes that turn the picture."""
    data = heif(codes, exif=exif_of({274: orientation}, {}).tobytes())
    turned = linear(upright(codes, orientation))

    frame = decode(data)

    assert frame.size == (turned.shape[1], turned.shape[0]) == read_header(data).size
    assert np.abs(frame.pixels - turned).max() < 0.03


@pytest.mark.parametrize("quality", [90, 95])
@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
@pytest.mark.parametrize("encoding", ["auto", "srgb"])
def test_clipped_light_in_heif_is_known_after_its_loss(
    kind: type[np.unsignedinteger[Any]], quality: int, encoding: str
) -> None:
    """The brighter half of a textured picture, of 8 bits and of 10, with halved colours."""
    rng = np.random.default_rng(3)
    x = np.linspace(0, 2, 256)[None, :, None] * np.array([1.0, 0.9, 0.8])
    light = x + 0.1 * np.sin(np.arange(256) / 3)[:, None, None] + rng.normal(0, 0.02, (256, 256, 1))
    white = np.iinfo(kind).max
    values = np.rint(np.clip(light, 0, 1) * white).astype(kind)

    frame = decode(heif(values, quality=quality, chroma=420), encoding)

    assert frame.saturated[(light > 1.02).any(axis=2)].mean() > 0.95
    assert frame.saturated[(light < 0.98).all(axis=2)].mean() < 0.01


def test_heif_that_is_said_to_be_linear_is_clipped_at_its_white_alone() -> None:
    values = np.full((64, 64, 3), 65535, np.uint16)
    values[32:] = 1020 * 64  # of 1023, bent to white by no curve

    frame = decode(heif(values, quality=-1), "linear")

    assert frame.saturated[:20].all()
    assert not frame.saturated[-20:].any()


@pytest.mark.parametrize(("encoding", "expected"), [("linear", 0.5), ("srgb", 0.2140)])
def test_the_encoding_can_be_told(tiff_file: Write, encoding: str, expected: float) -> None:
    half = np.full((8, 8, 3), 0.5)
    files = [
        tiff_file(half.astype(np.float32)),
        tiff_file((half * 65535).round().astype(np.uint16)),
        bytes(imagecodecs.png_encode((half * 65535).round().astype(np.uint16))),
    ]
    for data in files:
        frame = decode(data, encoding)
        assert frame.encoding == encoding
        np.testing.assert_allclose(frame.pixels, expected, atol=1e-4)


@pytest.mark.parametrize("kind", ["JPEG", "PNG", "TIFF"])
@pytest.mark.parametrize("orientation", range(1, 9))
def test_pictures_are_turned_upright(
    codes: Codes,
    pillow_file: Write,
    exif_of: Callable[..., PillowImage.Exif],
    kind: str,
    orientation: int,
) -> None:
    quality = {"quality": 98, "subsampling": 0} if kind == "JPEG" else {}
    data = pillow_file(codes, kind, exif=exif_of({274: orientation}, {}), **quality)
    with PillowImage.open(io.BytesIO(data)) as image:
        upright = np.asarray(ImageOps.exif_transpose(image))

    frame = decode(data)

    assert frame.size == (upright.shape[1], upright.shape[0]) == read_header(data).size
    assert np.abs(frame.pixels - linear(upright)).max() < (0.02 if kind == "JPEG" else 1e-6)


@pytest.mark.parametrize("byteorder", ["<", ">"])
@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize("orientation", [1, 3, 6])
def test_tiff_of_any_size_of_offsets_is_turned_upright(
    codes: Codes, tiff_file: Write, orientation: int, big: bool, byteorder: str
) -> None:
    tags = [(274, "H", 1, orientation, True)]
    data = tiff_file(codes, bigtiff=big, byteorder=byteorder, extratags=tags)
    turned = linear(upright(codes, orientation))

    frame = decode(data)

    assert frame.size == (turned.shape[1], turned.shape[0]) == read_header(data).size
    assert np.abs(frame.pixels - turned).max() < 1e-6


@pytest.mark.parametrize("kind", ["TIFF", "DNG", "JPEG"])
def test_nothing_holds_a_file_that_has_been_read(
    codes: Codes, pillow_file: Write, tiff_file: Write, dng_file: Write, kind: str
) -> None:
    """RAW files are large, and what refers to itself lives until the garbage is collected."""
    data = {
        "TIFF": lambda: tiff_file(codes),
        "DNG": lambda: dng_file(np.full((48, 64), 5000, np.uint16)),
        "JPEG": lambda: pillow_file(codes, "JPEG"),
    }[kind]()
    held = sys.getrefcount(data)
    gc.disable()
    try:
        read_header(data)
        decode(data)
        assert sys.getrefcount(data) == held
    finally:
        gc.enable()

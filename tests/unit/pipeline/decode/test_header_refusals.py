"""What a header tells of a file that is of no use is told before its pixels are read.

So the API refuses it, and no job has to fail.
"""

from __future__ import annotations

import io
import re
import struct
from collections.abc import Callable
from pathlib import Path

import imagecodecs
import Imath
import numpy as np
import OpenEXR
import pillow_heif
import pytest
from numpy.typing import NDArray

from pipeline.decode import read_header
from pipeline.errors import UnreadableImageError

Codes = NDArray[np.uint8]
Write = Callable[..., bytes]
FLOAT = Imath.PixelType(Imath.PixelType.FLOAT)
SOF_SAMPLING = 11
"""Where a JPEG's frame header has the sampling of its first component, from its marker on."""


def refusal(data: bytes) -> str:
    """The sentence that a file is refused with by its header."""
    with pytest.raises(UnreadableImageError) as caught:
        read_header(data, "flash photograph")
    sentence = str(caught.value)
    assert re.fullmatch(r"The flash photograph [^\n]+: [^\n]+\.", sentence)
    return sentence


@pytest.mark.parametrize("kind", ["JPEG", "PNG"])
@pytest.mark.parametrize("mode", ["L", "LA", "1"])
def test_grey_pictures_are_refused_with_the_reason(
    codes: Codes, pillow_file: Write, kind: str, mode: str
) -> None:
    if kind == "JPEG" and mode == "LA":
        mode = "L"
    assert "is grey" in refusal(pillow_file(codes, kind, mode))


def test_grey_tiff_and_exr_are_refused(codes: Codes, tiff_file: Write, exr_file: Write) -> None:
    grey = tiff_file(codes[..., 0], photometric="minisblack")
    assert "is grey" in refusal(grey)
    assert "without channels R, G and B" in refusal(exr_file(Y=np.ones((8, 8), np.float32)))


@pytest.mark.parametrize("bits", [8, 10])
def test_a_grey_heif_is_refused(codes: Codes, bits: int) -> None:
    plane = codes[..., 0] if bits == 8 else codes[..., 0].astype(np.uint16) << 8
    height, width = plane.shape
    file = io.BytesIO()
    mode = "L" if bits == 8 else "I;16"
    pillow_heif.from_bytes(mode, (width, height), plane.tobytes()).save(file, quality=90)
    assert "is grey" in refusal(file.getvalue())


@pytest.mark.parametrize("sampling", [0x42, 0x24, 0x14], ids=["4:1:0", "2 by 4", "4:4:1"])
def test_a_jpeg_of_an_unusual_sampling_is_not_called_damaged(
    codes: Codes, pillow_file: Write, sampling: int
) -> None:
    data = bytearray(pillow_file(codes, "JPEG", subsampling=2))
    data[data.index(b"\xff\xc0") + SOF_SAMPLING] = sampling
    assert "is a JPEG whose colours are sampled in an unusual way" in refusal(bytes(data))
    assert "is a damaged or incomplete JPEG" in refusal(bytes(data[: data.index(b"\xff\xda")]))


def test_an_exr_whose_colours_are_in_another_part_is_refused(tmp_path: Path) -> None:
    path, plane = tmp_path / "parts.exr", np.ones((8, 8), np.float32)
    kinds = [{"type": OpenEXR.scanlineimage, "name": name} for name in ("depth", "colours")]
    depth = OpenEXR.Part(kinds[0], {"Z": plane}, "depth")
    colours = OpenEXR.Part(kinds[1], dict.fromkeys("RGB", plane), "colours")
    OpenEXR.File([depth, colours]).write(str(path))

    assert "without channels R, G and B in its first part" in refusal(path.read_bytes())


@pytest.mark.parametrize("sampled", ["RB", "RGB"])
def test_an_exr_of_fewer_pixels_of_colours_is_refused(tmp_path: Path, sampled: str) -> None:
    """What its reader gives for them is whatever lies in memory."""
    header = OpenEXR.Header(8, 8)
    steps = {name: 2 if name in sampled else 1 for name in "RGB"}
    header["channels"] = {name: Imath.Channel(FLOAT, step, step) for name, step in steps.items()}
    path = tmp_path / "sampled.exr"
    file = OpenEXR.OutputFile(str(path), header)
    file.writePixels(
        {name: np.ones((8 // n, 8 // n), np.float32).tobytes() for name, n in steps.items()}
    )
    file.close()

    assert "whose colours have fewer pixels than the picture" in refusal(path.read_bytes())


@pytest.mark.parametrize("kind", ["12 bits", "without loss", "JPEG-LS"])
def test_jpegs_of_kinds_that_are_not_read_are_not_called_damaged(codes: Codes, kind: str) -> None:
    if kind == "JPEG-LS":
        data = imagecodecs.jpegls_encode(codes)
    elif kind == "12 bits":
        data = imagecodecs.jpeg8_encode(codes.astype(np.uint16) << 4, bitspersample=12)
    else:
        data = imagecodecs.jpeg8_encode(codes, lossless=True)

    assert "is a JPEG of more than 8 bits, or one without loss" in refusal(bytes(data))


def test_a_linear_dng_of_one_channel_is_grey(tiff_file: Write) -> None:
    """As monochrome cameras and converters write it."""
    tags = [(50706, "B", 4, (1, 4, 0, 0), True), (50708, "s", 0, "Unheard Of One", True)]
    values = np.full((64, 96), 5000, np.uint16)
    data = tiff_file(values, photometric="minisblack", extratags=tags)
    photometric = data.index(struct.pack("<HHI", 262, 3, 1)) + 8
    linear_raw = data[:photometric] + struct.pack("<H", 34892) + data[photometric + 2 :]

    assert "is grey, but lamps are told apart by their colours" in refusal(linear_raw)


def test_a_linear_dng_in_planes_is_refused(codes: Codes, tiff_file: Write) -> None:
    """LibRaw would read the planes as pixels."""
    tags = [(50706, "B", 4, (1, 4, 0, 0), True), (50708, "s", 0, "Unheard Of One", True)]
    values = np.moveaxis(codes.astype(np.uint16) * 257, 2, 0)
    data = tiff_file(values, photometric="linear_raw", planarconfig="separate", extratags=tags)

    assert "is a linear DNG with each colour in a plane of its own" in refusal(data)


def test_a_linear_dng_of_four_channels_is_not_called_damaged(tiff_file: Write) -> None:
    tags = [(50706, "B", 4, (1, 4, 0, 0), True), (50708, "s", 0, "Unheard Of One", True)]
    values = np.full((64, 96, 4), 5000, np.uint16)
    data = tiff_file(values, photometric="linear_raw", planarconfig="contig", extratags=tags)

    assert "is a linear DNG of 4 channels, which is not read: save it as a DNG of" in refusal(data)


def test_a_small_tiff_of_a_tile_that_is_larger_than_pictures_may_be_is_refused(
    tiff_file: Write, codes: Codes, monkeypatch: pytest.MonkeyPatch
) -> None:
    data = tiff_file(codes, tile=(128, 64))  # of which the picture is 48 × 64
    monkeypatch.setenv("LIGHTLAYERS_MAX_PIXELS", "8192")
    assert read_header(data).size == (64, 48)

    monkeypatch.setenv("LIGHTLAYERS_MAX_PIXELS", "8191")
    assert "is a damaged or incomplete TIFF" in refusal(data)


def test_16_bit_png_of_one_colour_channel_is_grey(codes: Codes) -> None:
    assert "is grey" in refusal(bytes(imagecodecs.png_encode(codes[..., 0].astype(np.uint16))))

from __future__ import annotations

import io
from typing import Any

import cv2
import numpy as np
import pillow_heif
import pytest
from numpy.typing import NDArray
from PIL import Image

from pipeline.colour.curves import srgb_to_linear
from pipeline.decode import decode
from pipeline.decode.recompressed import compressed_as_jpeg, recompressed

Codes = NDArray[np.uint8]
UNUSED = b"\xff\xdb\x00\x43\x02" + bytes([99]) * 64
"""A coarse quantization table of number 2."""


def scene(height: int = 240, width: int = 320) -> Codes:
    """Coloured patches with slanted edges and fine texture."""
    rng = np.random.default_rng(3)
    y, x = np.mgrid[:height, :width]
    patches = rng.uniform(20, 230, (40, 40, 3))
    picture = patches[((y + x // 3) // 20) % 40, ((x - y // 4) // 20) % 40]
    picture = picture * (1 + 0.2 * rng.standard_normal((height, width, 1)))
    return np.asarray(np.clip(picture, 0, 255), dtype=np.uint8)


def jpeg(codes: Codes, quality: int, subsampling: int = 0, **options: Any) -> bytes:
    file = io.BytesIO()
    Image.fromarray(codes).save(file, "JPEG", quality=quality, subsampling=subsampling, **options)
    return file.getvalue()


def pixels_of(data: bytes) -> Codes:
    return np.asarray(Image.open(io.BytesIO(data)).convert("RGB"))


def rms(one: NDArray[np.generic], other: NDArray[np.generic]) -> float:
    return float(np.sqrt(np.square(np.subtract(one, other, dtype=np.float64)).mean()))


@pytest.mark.parametrize("quality", [60, 80, 92, 98])
def test_compressing_again_changes_as_much_as_the_first_time(quality: int) -> None:
    """Within a tenth, whatever the quality."""
    original = scene()
    data = jpeg(original, quality)
    stored = pixels_of(data)

    parts = recompressed(data, stored)

    assert parts is not None
    before, after, _ = parts
    np.testing.assert_array_equal(before, stored[3:, 3:])
    assert rms(after, before) == pytest.approx(rms(stored, original), rel=0.1)


@pytest.mark.parametrize("subsampling", [1, 2])
def test_what_sampling_of_colours_has_lost_is_not_lost_twice(subsampling: int) -> None:
    """In a picture as soft as a lens draws, the part that is repeated is told within a fifth."""
    original = np.asarray(cv2.GaussianBlur(scene(), (0, 0), 0.8), dtype=np.uint8)
    data = jpeg(original, 92, subsampling)
    stored = pixels_of(data)

    parts = recompressed(data, stored)

    assert parts is not None
    before, after, repeated = parts
    again, first = (
        np.square(np.subtract(one, other, dtype=np.float64)).mean(axis=(0, 1))
        for one, other in ((after, before), (stored, original))
    )
    np.testing.assert_allclose(again / first, repeated, rtol=0.2)


def test_all_that_colours_at_every_pixel_lose_is_lost_again() -> None:
    data = jpeg(scene(), 92)

    parts = recompressed(data, pixels_of(data))

    assert parts is not None
    assert parts.repeated == (1.0, 1.0, 1.0)


@pytest.mark.parametrize("numbers", [(2, 3), (1, 0), (3, 1)])
@pytest.mark.parametrize("unused", [b"", UNUSED], ids=["", "unused"])
def test_a_file_may_number_its_tables_as_it_likes(numbers: tuple[int, int], unused: bytes) -> None:
    """Of luma and chroma, and hold more: the pixels are the same, and so is what changes."""
    data = jpeg(scene(), 85)
    numbered = bytearray(data)
    frame_header = data.index(b"\xff\xc0")
    for table, number in enumerate(numbers):
        numbered[data.index(b"\xff\xdb\x00\x43" + bytes([table])) + 4] = number
    for component in range(3):
        numbered[frame_header + 12 + 3 * component] = numbers[min(component, 1)]
    first = data.index(b"\xff\xdb")
    numbered[first:first] = unused  # before the others: table 2 is theirs where they have it

    found = recompressed(bytes(numbered), pixels_of(bytes(numbered)))
    expected = recompressed(data, pixels_of(data))

    assert found is not None
    assert expected is not None
    np.testing.assert_array_equal(found[1], expected[1])


def test_every_component_may_have_a_table_of_its_own() -> None:
    """What tells of blue is stored coarsely, what tells of red finely."""
    tables = [[4] * 64, [40] * 64, [4] * 64]
    data = jpeg(scene(), -1, qtables=tables)

    parts = recompressed(data, pixels_of(data))

    assert parts is not None
    before, after, _ = parts
    assert rms(after[..., 2], before[..., 2]) > 2 * rms(after[..., 0], before[..., 0])


def test_tables_of_16_bits_are_taken_in_silence(capfd: pytest.CaptureFixture[str]) -> None:
    original = scene()
    data = jpeg(original, -1, qtables=[[300] * 64])
    capfd.readouterr()  # what writing it has told the terminal
    stored = pixels_of(data)

    parts = recompressed(data, stored)

    assert parts is not None
    before, after, _ = parts
    assert rms(after, before) == pytest.approx(rms(stored, original), rel=0.3)
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("quality", [80, 92])
def test_red_green_and_blue_are_compressed_again_as_such(quality: int) -> None:
    """Not as luma and chroma, of which the latter would fall under the table of green."""
    original = scene()
    data = jpeg(original, quality, keep_rgb=True)
    stored = pixels_of(data)

    parts = recompressed(data, stored)

    assert parts is not None
    before, after, _ = parts
    for channel in range(3):
        first = rms(stored[..., channel], original[..., channel])
        assert rms(after[..., channel], before[..., channel]) == pytest.approx(first, rel=0.1)


def test_of_a_large_picture_parts_are_compressed() -> None:
    data = jpeg(scene(1200, 1000), 90)

    parts = recompressed(data, pixels_of(data))

    assert parts is not None
    before, after, _ = parts
    assert before.shape == after.shape
    assert 400_000 < before.shape[0] * before.shape[1] <= 500_000


@pytest.mark.parametrize("size", [(1, 1), (3, 50), (10, 50), (50, 10)])
def test_a_tiny_picture_tells_nothing(size: tuple[int, int]) -> None:
    data = jpeg(scene(*size), 90)

    assert recompressed(data, pixels_of(data)) is None


@pytest.mark.parametrize(
    "segment",
    [b"\xff\xe0\x00\x07JFIF\x00", b"\xff\xe2\x00\x0eICC_PROFILE\x00"],
    ids=["short JFIF", "empty profile"],
)
def test_a_header_that_pillow_cannot_read_tells_nothing(segment: bytes) -> None:
    """The picture is sound all the same."""
    data = jpeg(scene(), 90)
    odd = data[:2] + segment + data[2:]

    frame = decode(odd)

    np.testing.assert_array_equal(frame.pixels, decode(data).pixels)
    assert frame.compression is None
    assert recompressed(odd, pixels_of(data)) is None


def test_a_frame_knows_what_its_compression_changed() -> None:
    """Half as much again, in linear light, within a fifth; a PNG of the same knows nothing."""
    original = scene()
    data = jpeg(original, 85)
    stored = pixels_of(data)
    light, true = (srgb_to_linear(codes.astype(np.float32) / 255) for codes in (stored, original))
    png = io.BytesIO()
    Image.fromarray(stored).save(png, "PNG")

    found = decode(data).compression

    assert found is not None
    change = np.square(light - true).reshape(-1, 3).mean(axis=0)
    ratio = found.variance(light).reshape(-1, 3).mean(axis=0) / change
    np.testing.assert_allclose(ratio, 1.5, rtol=0.2)
    assert decode(png.getvalue()).compression is None


@pytest.mark.parametrize("size", [(2, 2), (8, 8), (9, 300)])
def test_small_pictures_are_decoded_all_the_same(size: tuple[int, int]) -> None:
    frame = decode(jpeg(scene(*size), 90))

    assert frame.size == (size[1], size[0])
    assert frame.compression is None


# HEIF


def heif(codes: NDArray[Any], quality: int) -> bytes:
    """As phones write them: colours sampled at every second pixel."""
    mode = "RGB" if codes.dtype == np.uint8 else "RGB;16"
    file = io.BytesIO()
    image = pillow_heif.from_bytes(mode, codes.shape[1::-1], codes.tobytes())
    image.save(file, quality=quality, chroma=420)
    return file.getvalue()


@pytest.mark.parametrize("quality", [60, 80])
def test_a_frame_knows_nearly_what_hevc_changed(quality: int) -> None:
    """Of a picture as soft as a lens draws, in linear light: as much up to five times as much."""
    original = np.asarray(cv2.GaussianBlur(scene(), (0, 0), 0.8), dtype=np.uint8)
    data = heif(original, quality)
    stored = np.asarray(pillow_heif.open_heif(data))
    light, true = (srgb_to_linear(codes.astype(np.float32) / 255) for codes in (stored, original))

    found = decode(data).compression

    assert found is not None
    change = np.square(light - true).reshape(-1, 3).mean(axis=0)
    ratio = found.variance(light).reshape(-1, 3).mean(axis=0) / change
    assert (ratio > 1.0).all(), ratio
    assert (ratio < 5.0).all(), ratio


def test_heif_of_10_bits_is_told_as_of_8() -> None:
    codes = scene()

    fine, coarse = compressed_as_jpeg(codes.astype(np.uint16) * 257), compressed_as_jpeg(codes)

    assert fine is not None
    assert coarse is not None
    np.testing.assert_array_equal(fine.before, coarse.before)
    np.testing.assert_array_equal(fine.after, coarse.after)
    assert coarse.repeated == (0.6, 0.8, 0.6)


def test_of_10_bits_a_frame_knows_as_much_as_of_8() -> None:
    codes = scene()

    fine = decode(heif(codes.astype(np.uint16) * 257, 80)).compression
    coarse = decode(heif(codes, 80)).compression

    assert fine is not None
    assert coarse is not None
    np.testing.assert_allclose(fine.gain, coarse.gain, rtol=0.1)


@pytest.mark.parametrize("size", [(1, 1), (10, 50)])
def test_a_tiny_picture_of_heif_tells_nothing(size: tuple[int, int]) -> None:
    assert compressed_as_jpeg(scene(*size)) is None

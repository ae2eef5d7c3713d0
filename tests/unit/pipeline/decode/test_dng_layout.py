"""Where the samples of a DNG lie in the file: found, or refused by name."""

from __future__ import annotations

import io
from collections.abc import Callable
from typing import Any

import imagecodecs
import numpy as np
import pytest
import tifffile
from numpy.typing import NDArray

from pipeline.decode import decode
from tests.jpeg_xl import in_jpeg_xl
from tests.refusal import refusal
from tests.same_frame import assert_same

Write = Callable[..., bytes]
BLACK, WHITE = 50714, 50717
NONE, JPEG, LOSSY = 1, 7, 34892
PATTERN_SIZE, PATTERN = 33421, 33422
HEIGHT, WIDTH = 64, 96


def values(*shape: int, most: int = 65535, dtype: type = np.uint16) -> NDArray[Any]:
    return np.random.default_rng(5).integers(0, most, shape, endpoint=True).astype(dtype)


def lossless(samples: NDArray[Any]) -> bytes:
    """A mosaic as a JPEG without loss, of one colour."""
    return bytes(imagecodecs.ljpeg_encode(np.ascontiguousarray(samples), bitspersample=16))


def moved_apart(dng: bytes) -> bytes:
    """With two bytes after each strip."""
    return in_jpeg_xl(dng, lambda strip: strip.tobytes() + b"\0\0", compression=NONE)


def swapped(dng: bytes) -> bytes:
    """With the first two strips in each other's place."""
    file = io.BytesIO(dng)
    with tifffile.TiffFile(file, mode="r+") as tiff:
        tag = tiff.pages.first.tags["StripOffsets"]
        first, second, *others = tag.value
        tag.overwrite([second, first, *others])
    return file.getvalue()


@pytest.mark.parametrize("shape", [(HEIGHT, WIDTH), (HEIGHT, WIDTH, 3)], ids=["mosaic", "linear"])
@pytest.mark.parametrize(
    "layout",
    [
        {"rowsperstrip": 20},
        {"tile": (32, 32)},
        {"tile": (48, 64)},
        {"tile": (128, 96)},
        {"byteorder": ">"},
        {"byteorder": ">", "tile": (48, 64)},
    ],
)
@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_samples_are_found(
    dng: Write, shape: tuple[int, ...], layout: dict[str, Any], kind: type
) -> None:
    samples = values(*shape, most=np.iinfo(kind).max, dtype=kind)

    assert_same(dng(samples, **layout), dng(samples))


@pytest.mark.parametrize("shape", [(HEIGHT, WIDTH), (HEIGHT, WIDTH, 3)], ids=["mosaic", "linear"])
@pytest.mark.parametrize("kind", [np.float16, np.float32])
def test_floats_in_tiles_that_end_with_the_picture_are_found(
    dng: Write, shape: tuple[int, ...], kind: type
) -> None:
    samples: NDArray[Any] = (np.random.default_rng(5).integers(0, 1000, shape) / 1024).astype(kind)
    white = (WHITE, "H", 1, 1)

    assert_same(dng(samples, white, tile=(32, 32)), dng(samples, white))


@pytest.mark.parametrize("shape", [(HEIGHT, 97), (HEIGHT, 97, 3)], ids=["mosaic", "linear"])
@pytest.mark.parametrize("bits", [10, 12, 14])
def test_packed_samples_are_found(dng: Write, shape: tuple[int, ...], bits: int) -> None:
    samples = values(*shape, most=2**bits - 1)
    white = (WHITE, "H", 1, 2**bits - 1)

    packed = dng(samples, white, bitspersample=bits)

    assert len(packed) < len(dng(samples, white))
    assert_same(packed, dng(samples, white))


@pytest.mark.parametrize("layout", [{}, {"tile": (32, 32)}, {"tile": (48, 64)}])
def test_samples_without_loss_are_found(dng: Write, layout: dict[str, Any]) -> None:
    samples = values(HEIGHT, WIDTH)

    data = in_jpeg_xl(dng(samples, **layout), lossless, compression=JPEG)

    assert_same(data, dng(samples))


def assert_refused(data: bytes, reason: str) -> None:
    sentence = refusal(data)
    assert f"is a DNG that has {reason}" in sentence
    assert sentence.endswith("save it anew with a DNG converter, or as a TIFF of 16 bits.")


@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.float16, np.float32])
@pytest.mark.parametrize("shape", [(HEIGHT, WIDTH), (HEIGHT, WIDTH, 3)], ids=["mosaic", "linear"])
@pytest.mark.parametrize("tile", [(128, 128), (64, 112), (32, 128)])
def test_tiles_wider_than_the_picture_are_refused(
    dng: Write, tile: tuple[int, int], shape: tuple[int, ...], kind: type
) -> None:
    """LibRaw takes what is beyond the edge for the next row."""
    data = dng(values(*shape, most=1, dtype=kind), (WHITE, "H", 1, 1), tile=tile)

    assert_refused(data, "tiles wider than its picture (TileWidth)")


def test_wide_tiles_of_jpeg_are_refused(dng: Write) -> None:
    data = in_jpeg_xl(dng(values(HEIGHT, WIDTH), tile=(32, 128)), lossless, compression=JPEG)

    assert_refused(data, "tiles wider than its picture (TileWidth)")


@pytest.mark.parametrize("shape", [(HEIGHT, WIDTH), (HEIGHT, WIDTH, 3)], ids=["mosaic", "linear"])
def test_half_floats_beyond_the_edge_are_refused(dng: Write, shape: tuple[int, ...]) -> None:
    data = dng(values(*shape, most=1, dtype=np.float16), (WHITE, "H", 1, 1), tile=(32, 64))

    assert_refused(data, "tiles of floats beyond the edge of its picture (TileWidth)")


@pytest.mark.parametrize("change", [moved_apart, swapped])
@pytest.mark.parametrize("shape", [(HEIGHT, WIDTH), (HEIGHT, WIDTH, 3)], ids=["mosaic", "linear"])
def test_strips_elsewhere_are_refused(
    dng: Write, shape: tuple[int, ...], change: Callable[[bytes], bytes]
) -> None:
    """LibRaw goes on where the first ends."""
    data = change(dng(values(*shape), rowsperstrip=16))

    assert_refused(data, "strips that do not follow one another (StripOffsets)")


def test_strips_of_jpeg_are_refused(dng: Write) -> None:
    data = in_jpeg_xl(dng(values(HEIGHT, WIDTH), rowsperstrip=20), lossless, compression=JPEG)

    assert_refused(data, "strips of JPEG (RowsPerStrip)")


@pytest.mark.parametrize("tag", [50975, 52547])
def test_rows_and_columns_sorted_by_fields_are_refused(dng: Write, tag: int) -> None:
    assert_refused(dng(values(HEIGHT, WIDTH), (tag, "H", 1, 2)), "rows or columns sorted by fields")


def lossy(samples: NDArray[Any]) -> bytes:
    return bytes(imagecodecs.jpeg8_encode(np.ascontiguousarray(samples), level=95))


@pytest.mark.parametrize("shape", [(HEIGHT, WIDTH), (HEIGHT, WIDTH, 3)], ids=["mosaic", "linear"])
def test_a_jpeg_with_loss_that_is_called_one_without_is_refused(
    dng: Write, shape: tuple[int, ...]
) -> None:
    """LibRaw leaves it black."""
    samples = values(*shape, most=255, dtype=np.uint8)
    data = in_jpeg_xl(dng(samples, tile=(32, 32)), lossy, compression=JPEG)

    assert_refused(data, "tiles or strips that are no JPEG without loss (Compression)")


def test_colours_side_by_side_are_refused(dng: Write) -> None:
    data = in_jpeg_xl(
        dng(values(HEIGHT, WIDTH, 3), tile=(32, 32)),
        lambda tile: lossless(tile.reshape(len(tile), -1)),
        compression=JPEG,
    )

    assert_refused(data, "tiles or strips that are no JPEG without loss (Compression)")


def test_a_tile_without_its_beginning_is_damaged(dng: Write) -> None:
    """LibRaw leaves it as the memory was."""
    data = in_jpeg_xl(dng(values(HEIGHT, WIDTH), tile=(32, 32)), lossless, compression=JPEG)
    with tifffile.TiffFile(io.BytesIO(data)) as tiff:
        at = tiff.pages.first.dataoffsets[4]

    assert "damaged or incomplete" in refusal(data[:at] + bytes(20) + data[at + 20 :])


def test_margins_around_a_lossy_picture_are_refused(dng: Write) -> None:
    samples = values(HEIGHT, WIDTH, 3, most=255, dtype=np.uint8)
    area = (50829, "I", 4, (4, 6, 60, 90))
    data = in_jpeg_xl(dng(samples, area, *identity(), tile=(32, 32)), lossy, compression=LOSSY)

    assert_refused(data, "margins around a lossy picture (ActiveArea)")


@pytest.mark.parametrize(
    "level", [(BLACK, "H", 3, (10,) * 3), (WHITE, "H", 3, (250,) * 3), (WHITE, "H", 1, 128)]
)
def test_levels_of_a_lossy_picture_are_refused(dng: Write, level: tuple[Any, ...]) -> None:
    """LibRaw takes 8 bits from 0 to 255."""
    samples = values(HEIGHT, WIDTH, 3, most=255, dtype=np.uint8)
    data = in_jpeg_xl(dng(samples, level, *identity(), tile=(32, 32)), lossy, compression=LOSSY)

    assert "is a lossy DNG with levels of black or white" in refusal(data)


def identity() -> list[tuple[Any, ...]]:
    """Polynomials that leave lossy values as they are, without which none are read."""
    one = b"".join(
        np.array([8, 0x01030000, 0, 52, 0, 0, HEIGHT, WIDTH, plane, 1, 1, 1, 1], ">u4").tobytes()
        + np.array([0, 1], ">f8").tobytes()
        for plane in range(3)
    )
    block = b"\0\0\0\3" + one
    return [(51009, 7, len(block), block)]


@pytest.mark.parametrize("white", [None, 255, 65535])
def test_a_lossy_picture_from_0_to_white_is_read(dng: Write, white: int | None) -> None:
    samples = np.full((HEIGHT, WIDTH, 3), (60, 120, 90), np.uint8)
    level = [] if white is None else [(WHITE, "I", 3, (white,) * 3)]
    data = in_jpeg_xl(dng(samples, *level, *identity(), tile=(32, 32)), lossy, compression=LOSSY)

    np.testing.assert_allclose(decode(data).pixels, samples / 255, atol=0.01)


@pytest.mark.parametrize(
    ("tags", "reason"),
    [
        (((50711, "H", 1, 3),), "photosites that stand in no rectangle (CFALayout)"),
        (((50710, "B", 3, (1, 0, 2)),), "colours in another order (CFAPlaneColor)"),
        (
            (
                (PATTERN_SIZE, "H", 2, (4, 4)),
                (PATTERN, "B", 16, (0, 0, 1, 1) * 2 + (1, 1, 2, 2) * 2),
            ),
            "a colour pattern of 4 × 4 photosites (CFARepeatPatternDim)",
        ),
        (
            ((PATTERN_SIZE, "H", 2, (1, 3)), (PATTERN, "B", 3, (0, 1, 2))),
            "a colour pattern of 1 × 3 photosites (CFARepeatPatternDim)",
        ),
        (
            ((PATTERN_SIZE, "H", 2, (6, 2)), (PATTERN, "B", 12, (0, 1, 1, 2) * 3)),
            "a colour pattern of 6 × 2 photosites (CFARepeatPatternDim)",
        ),
    ],
)
def test_other_sensors_are_refused(
    dng: Write, tags: tuple[tuple[Any, ...], ...], reason: str
) -> None:
    """LibRaw takes their photosites for others' colours."""
    assert_refused(dng(values(HEIGHT, WIDTH), *tags), reason)


def test_the_same_pattern_written_twice_is_read(dng: Write) -> None:
    twice = ((PATTERN_SIZE, "H", 2, (4, 2)), (PATTERN, "B", 8, (0, 1, 1, 2) * 2))
    samples = values(HEIGHT, WIDTH)

    assert_same(dng(samples, *twice, (50711, "H", 1, 1), (50710, "B", 3, (0, 1, 2))), dng(samples))


def test_floats_that_are_no_numbers_are_refused(dng: Write) -> None:
    samples = np.full((HEIGHT, WIDTH, 3), 0.5, np.float32)
    samples[20, 30, 1] = np.nan

    assert "or that are no numbers: save it" in refusal(dng(samples))

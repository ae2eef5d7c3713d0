"""A DNG in JPEG XL is the same picture as the same DNG uncompressed."""

from __future__ import annotations

import io
import tracemalloc
from collections.abc import Callable
from typing import Any

import imagecodecs
import numpy as np
import pytest
import tifffile
from numpy.typing import NDArray

from pipeline.decode import decode, read_header
from pipeline.decode.dng_jxl import described, uncompressed
from pipeline.errors import ImageTooLargeError
from tests.jpeg_xl import in_jpeg_xl, lossless
from tests.refusal import refusal
from tests.same_frame import assert_same

Write = Callable[..., bytes]
Tags = tuple[tuple[Any, ...], ...]
BLACK, WHITE, TABLE = 50714, 50717, 50712
ROWS, COLUMNS = 50975, 52547
CROP = ((50719, "I", 2, (9, 3)), (50720, "I", 2, (80, 50)))
TURNED = (274, "H", 1, 6)
MATRIX = (
    (50721, "2i", 9, [part for value in (9, -3, -1, -4, 12, 2, -1, 2, 7) for part in (value, 10)]),
    (50778, "H", 1, 21),
)
SQUARES = tuple(int(65535 * (code / 1023) ** 2) for code in range(1024))


def noise(*shape: int, most: int = 60000, dtype: type = np.uint16) -> NDArray[Any]:
    values = np.random.default_rng(7).integers(most // 100, most, shape)
    return values.astype(dtype)


@pytest.mark.parametrize("shape", [(64, 96), (64, 96, 3)], ids=["mosaic", "linear"])
@pytest.mark.parametrize(
    "layout",
    [
        {},
        {"rowsperstrip": 20},
        {"tile": (32, 32)},
        {"tile": (48, 64)},
        {"tile": (128, 128)},
        {"tile": (48, 64), "byteorder": ">"},
    ],
    ids=["one strip", "strips", "tiles", "tiles beyond the edge", "a larger tile", "big-endian"],
)
@pytest.mark.parametrize(
    "tags",
    [
        (),
        (TURNED, *MATRIX, *CROP, (271, "s", 0, "ACME"), (34855, "H", 1, 200)),
        ((BLACK, "H", 1, 900), (WHITE, "I", 1, 52000), *CROP),
        ((TABLE, "H", 1024, SQUARES), (WHITE, "I", 1, 60000)),
    ],
    ids=["plain", "facts", "levels", "table"],
)
def test_a_dng_in_jpeg_xl_is_the_same_picture(
    dng: Write, shape: tuple[int, ...], layout: dict[str, Any], tags: Tags
) -> None:
    values = noise(*shape, most=1023 if (TABLE, "H", 1024, SQUARES) in tags else 60000)

    assert_same(in_jpeg_xl(dng(values, *tags, **layout)), dng(values, *tags))


@pytest.mark.parametrize("rows", [1, 2, 3])
@pytest.mark.parametrize("columns", [1, 2, 4])
@pytest.mark.parametrize("size", [(64, 96), (65, 97)], ids=["even", "odd"])
def test_sorted_rows_and_columns_are_put_back(
    dng: Write, rows: int, columns: int, size: tuple[int, int]
) -> None:
    """Mosaics are stored as a picture for each photosite of their pattern, side by side."""
    values = noise(*size)
    by_rows = np.concatenate([values[first::rows] for first in range(rows)])
    stored = np.concatenate([by_rows[:, first::columns] for first in range(columns)], axis=1)
    fields = ((ROWS, "H", 1, rows), (COLUMNS, "I", 1, columns))

    data = in_jpeg_xl(dng(stored, *fields, tile=(48, 64)))

    assert_same(data, dng(values))


def test_as_many_fields_as_rows_are_none(dng: Write) -> None:
    values = noise(64, 96)
    fields = ((ROWS, "H", 1, 64), (COLUMNS, "H", 1, 200))

    assert_same(in_jpeg_xl(dng(values, *fields)), dng(values))


def test_numbers_of_10_bits_in_16_stay_what_they_are(dng: Write) -> None:
    """For a table of 1024; loss makes some larger than its last one."""
    values = noise(64, 96, 3, most=1023)
    values[5, 6] = 1023
    tags = ((TABLE, "H", 1024, SQUARES), (WHITE, "I", 3, (65535,) * 3))
    over = values.copy()
    over[5, 6] = 1027

    data = in_jpeg_xl(dng(over, *tags, tile=(32, 48)), bits=10)

    assert_same(data, dng(values, *tags))
    assert decode(data).saturated[5, 6]


def test_10_bits_are_16_where_white_is(dng: Write) -> None:
    """However many the stream has."""
    codes = noise(64, 96, 3, most=1023)
    full = np.rint(codes * (65535 / 1023)).astype(np.uint16)
    white = (WHITE, "I", 3, (65535,) * 3)

    def encode(values: NDArray[Any]) -> bytes:
        return bytes(imagecodecs.jpegxl_encode(values, lossless=True, bitspersample=10))

    assert_same(in_jpeg_xl(dng(codes, white), encode, bits=10), dng(full, white))
    assert_same(in_jpeg_xl(dng(full, white), bits=10), dng(full, white))


@pytest.mark.parametrize("container", [False, True])
def test_fewer_bits_than_are_told_are_stretched(dng: Write, container: bool) -> None:
    codes = noise(64, 96, 3, most=4095)

    def encode(values: NDArray[Any]) -> bytes:
        options: dict[str, Any] = {"bitspersample": 12, "usecontainer": container}
        return bytes(imagecodecs.jpegxl_encode(values, lossless=True, **options))

    full = np.rint(codes * (65535 / 4095)).astype(np.uint16)
    assert_same(in_jpeg_xl(dng(codes), encode), dng(full))
    white = (WHITE, "H", 1, 4095)
    assert_same(in_jpeg_xl(dng(codes, white), encode, bits=12), dng(codes, white))


@pytest.mark.parametrize("kind", [np.uint8, np.float16, np.float32])
def test_other_samples_are_read(dng: Write, kind: type) -> None:
    most = 255 if kind is np.uint8 else 1
    values: NDArray[Any] = (noise(64, 96, 3) / 65535 * most).astype(kind)
    tags = ((WHITE, "I", 3, (most,) * 3),)
    twin = dng(values, *tags)

    assert_same(in_jpeg_xl(twin), twin)


def test_lossy_ones_are_nearly_the_same(dng: Write) -> None:
    x = np.linspace(4000, 50000, 96)[None, :, None]
    values = (x * np.linspace(1, 0.5, 64)[:, None, None] * [0.6, 1, 0.8]).astype(np.uint16)
    twin = dng(values)

    data = in_jpeg_xl(twin, lambda tile: bytes(imagecodecs.jpegxl_encode(tile, distance=0.5)))

    frame, expected = decode(data), decode(twin)
    assert 0 < np.abs(frame.pixels - expected.pixels[:]).max() < 0.01


def test_previews_and_masks_stay_as_they_are() -> None:
    """The picture is a sub-directory, as a phone writes it."""
    values = noise(64, 96, 3)
    mask = noise(32, 48, most=255, dtype=np.uint8)

    def phone() -> bytes:
        file = io.BytesIO()
        common = dict[str, Any](metadata=None, software=False)
        tags = [(50706, "B", 4, (1, 7, 0, 0), True), (50708, "s", 0, "Unheard Of One", True)]
        with tifffile.TiffWriter(file) as tiff:
            preview = np.full((16, 24, 3), 90, np.uint8)
            smaller = dict[str, Any](subfiletype=1, **common)
            tiff.write(preview, photometric="rgb", subifds=2, extratags=tags, **smaller)
            tiff.write(values, photometric="linear_raw", subfiletype=0, tile=(32, 32), **common)
            tiff.write(mask, photometric="minisblack", compression="jpegxl_dng", **smaller)
        return file.getvalue()

    twin = phone()
    data = in_jpeg_xl(twin, page=0)
    made = uncompressed(data)

    assert_same(data, twin)
    with tifffile.TiffFile(io.BytesIO(made)) as tiff:
        pages = tiff.pages.first.pages
        assert pages is not None
        np.testing.assert_array_equal(pages[0].asarray(), values)
        np.testing.assert_array_equal(pages[1].asarray(), mask)
        assert pages[1].aspage().compression == 52546


def test_all_else_is_as_it_was(dng: Write) -> None:
    """In the file itself, and by its names, beside what tells of the samples."""
    tags = (TURNED, *MATRIX, *CROP, (BLACK, "H", 1, 900), (51009, 7, 8, bytes(8)))
    data = in_jpeg_xl(dng(noise(64, 96, 3), *tags, tile=(32, 32)))

    def told(file: bytes) -> dict[int, Any]:
        with tifffile.TiffFile(io.BytesIO(file)) as tiff:
            return {tag.code: tag.value for tag in tiff.pages.first.tags}

    before, after = told(data), told(uncompressed(data))
    changed = {tag for tag in before if before[tag] != after[tag]}
    assert before.keys() == after.keys()
    assert changed == {259, 322, 323, 324, 325}


def test_a_header_is_described_without_its_samples(
    dng: Write, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delattr(imagecodecs, "jpegxl_decode")
    data = in_jpeg_xl(dng(noise(640, 960, 3), *CROP))

    assert len(described(data)) < len(data) + 20
    assert read_header(data).size == (80, 50)


def test_other_files_are_given_as_they_are(dng: Write, tiff_file: Write) -> None:
    values = noise(64, 96, 3)
    files = [dng(values), b"", b"II*\0", bytes(500)]
    files.append(tiff_file(values, compression="jpegxl_dng"))
    files.append(
        tiff_file(values, photometric="linear_raw", compression="jpegxl_dng", bigtiff=True)
    )

    for data in files:
        assert uncompressed(data) is data
        assert described(data) is data


def test_samples_are_in_memory_once(dng: Write) -> None:
    values = np.full((3000, 2000, 3), 3000, np.uint16)
    data = in_jpeg_xl(dng(values, tile=(512, 512)))

    tracemalloc.start()
    try:
        made = uncompressed(data)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()

    assert len(made) > values.nbytes
    assert peak < len(data) + 1.3 * values.nbytes


def test_want_of_memory_is_not_taken_for_damage(
    dng: Write, monkeypatch: pytest.MonkeyPatch
) -> None:
    def decode_jpeg_xl(*_arguments: Any, **_options: Any) -> None:
        raise MemoryError

    monkeypatch.setattr(imagecodecs, "jpegxl_decode", decode_jpeg_xl)
    with pytest.raises(MemoryError):
        decode(in_jpeg_xl(dng(noise(64, 96, 3))))


def replaced(data: bytes, tag: str, value: Any) -> bytes:
    file = io.BytesIO(data)
    with tifffile.TiffFile(file, mode="r+") as tiff:
        tiff.pages.first.tags[tag].overwrite(value)
    return file.getvalue()


def tags_of(data: bytes) -> dict[str, Any]:
    with tifffile.TiffFile(io.BytesIO(data)) as tiff:
        return {tag.name: tag.value for tag in tiff.pages.first.tags}


@pytest.mark.parametrize("shape", [(64, 96), (64, 96, 3)], ids=["mosaic", "linear"])
@pytest.mark.parametrize("start", [0, 2, 20, 200])
def test_a_damaged_tile_is_told(dng: Write, shape: tuple[int, ...], start: int) -> None:
    data = in_jpeg_xl(dng(noise(*shape), tile=(32, 32)))
    tags = tags_of(data)
    at = tags["TileOffsets"][3]
    end = at + tags["TileByteCounts"][3]

    bad = data[: at + start] + bytes(end - at - start) + data[end:]

    assert "is a damaged or incomplete RAW file: send it again." in refusal(bad)


@pytest.mark.parametrize(
    "encode",
    [
        lambda tile: lossless(tile[:-1]),
        lambda tile: lossless(tile[:, :-1]),
        lambda tile: lossless(np.concatenate([tile, tile])),
        lambda tile: lossless(tile[..., 0]),
        lambda tile: lossless(np.concatenate([tile, tile[..., :1]], axis=2)),
        lambda tile: lossless((tile / 65535).astype(np.float32)),
        lambda tile: lossless((tile / 65535).astype(np.float16)),
        lambda tile: lossless(np.stack([tile, tile])),
        lambda _tile: b"",
        lambda tile: bytes(imagecodecs.jpeg8_encode((tile // 256).astype(np.uint8))),
    ],
    ids=[
        "lower",
        "narrower",
        "higher",
        "one channel",
        "four channels",
        "floats",
        "half floats",
        "two pictures",
        "nothing",
        "a JPEG",
    ],
)
def test_tiles_other_than_are_told_are_damaged(
    dng: Write, encode: Callable[[NDArray[Any]], bytes]
) -> None:
    data = in_jpeg_xl(dng(noise(64, 96, 3), tile=(32, 32)), encode)

    assert "is a damaged or incomplete RAW file: send it again." in refusal(data)


@pytest.mark.parametrize(
    ("told", "given"),
    [
        (np.uint8, np.uint16),
        (np.float16, np.float32),
        (np.float16, np.uint16),
        (np.float32, np.uint8),
        (np.uint16, np.float16),
    ],
)
def test_samples_of_another_kind_than_is_told_are_damaged(
    dng: Write, told: type, given: type
) -> None:
    values: NDArray[Any] = np.ones((64, 96, 3), told)
    white = (WHITE, "H", 1, 1)
    data = in_jpeg_xl(dng(values, white), lambda tile: lossless(tile.astype(given)))

    assert "is a damaged or incomplete RAW file: send it again." in refusal(data)


@pytest.mark.parametrize(
    ("tag", "value"),
    [
        ("TileByteCounts", [100] * 5),
        ("TileByteCounts", [65535] * 6),
        ("TileOffsets", [10**9] * 6),
        ("TileOffsets", [8] * 6),
        ("TileWidth", 2**31),
        ("TileWidth", 64),
        ("TileLength", 2**31),
        ("ImageWidth", 60000),
        ("BitsPerSample", [0] * 3),
        ("BitsPerSample", [32] * 3),
        ("BitsPerSample", [16]),
    ],
)
def test_a_directory_that_cannot_be_is_damaged(dng: Write, tag: str, value: Any) -> None:
    levels = (WHITE, "I", 3, (65535,) * 3)
    data = in_jpeg_xl(dng(noise(64, 96, 3), levels, tile=(32, 32)))

    assert "damaged" in refusal(replaced(data, tag, value))


@pytest.mark.parametrize("tag", [ROWS, COLUMNS])
@pytest.mark.parametrize("fields", [(0,), (2, 2)])
def test_fields_that_cannot_be_are_damaged(dng: Write, tag: int, fields: tuple[int, ...]) -> None:
    data = in_jpeg_xl(dng(noise(64, 96), (tag, "H", len(fields), fields)))

    assert "damaged" in refusal(data)


def test_grey_ones_and_those_of_four_channels_are_refused(dng: Write, tiff_file: Write) -> None:
    tags = [(50706, "B", 4, (1, 7, 0, 0), True), (50708, "s", 0, "Unheard Of One", True)]
    options = {"photometric": "linear_raw", "compression": "jpegxl_dng", "planarconfig": 1}
    four = tiff_file(noise(64, 96, 4), extratags=tags, **options)
    grey = replaced(in_jpeg_xl(dng(noise(64, 96, 3))), "SamplesPerPixel", 2)

    assert "is a DNG in JPEG XL of 4 channels, which is not read: save it as an" in refusal(four)
    assert "is grey" in refusal(grey)


def test_10_bits_without_a_white_level_are_refused(dng: Write) -> None:
    data = in_jpeg_xl(dng(noise(64, 96, 3, most=1023)), bits=10)

    assert "is a DNG in JPEG XL that does not tell its white level: save it as" in refusal(data)


def test_absurd_sizes_are_refused_before_anything_is_decoded(
    dng: Write, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Tiles of one value take a few bytes each."""
    monkeypatch.delattr(imagecodecs, "jpegxl_decode")
    data = in_jpeg_xl(dng(np.full((64, 96, 3), 3000, np.uint16)))
    large = replaced(replaced(data, "ImageWidth", 30000), "ImageLength", 20000)

    for read in (read_header, decode):
        with pytest.raises(ImageTooLargeError, match="30000 × 20000 pixels, more than the limit"):
            read(large)

"""Files that cannot be used end in one sentence of the right kind, and in nothing else."""

from __future__ import annotations

import io
import re
import struct
import subprocess
import sys
from collections.abc import Callable
from typing import Any

import imagecodecs
import Imath
import numpy as np
import pillow_heif
import pytest
import tifffile
from numpy.typing import NDArray

from pipeline.decode import decode, read_header
from pipeline.errors import ImageTooLargeError, OptionError, UnreadableImageError
from tests.jpeg_xl import in_jpeg_xl
from tests.png_bombs import png_bomb, png_of

Codes = NDArray[np.uint8]
Write = Callable[..., bytes]
FLOAT = Imath.PixelType(Imath.PixelType.FLOAT)


def refusal(data: bytes, **options: Any) -> str:
    """The sentence that a file is refused with."""
    with pytest.raises(UnreadableImageError) as caught:
        decode(data, name="flash photograph", **options)
    sentence = str(caught.value)
    assert re.fullmatch(r"The flash photograph [^\n]+: [^\n]+\.", sentence)
    return sentence


@pytest.fixture
def every_kind(
    pillow_file: Write, tiff_file: Write, dng_file: Write, exr_file: Write
) -> dict[str, bytes]:
    rng = np.random.default_rng(1)
    noise = rng.integers(0, 255, (64, 96, 3), dtype=np.uint8)
    heif = io.BytesIO()
    pillow_heif.from_bytes("RGB", (96, 64), noise.tobytes()).save(heif)
    plane = (noise[..., 0] / 255).astype(np.float32)
    dng = dng_file(rng.integers(600, 15000, (64, 96), dtype=np.uint16))
    return {
        "JPEG": pillow_file(noise, "JPEG"),
        "progressive JPEG": pillow_file(noise, "JPEG", progressive=True),
        "PNG": pillow_file(noise, "PNG"),
        "TIFF": tiff_file(noise),
        "deflated TIFF": tiff_file(noise, compression="deflate"),
        "tiled TIFF": tiff_file(noise, tile=(32, 32)),
        "float TIFF": tiff_file((noise / 255).astype(np.float32)),
        "EXR": exr_file(R=plane, G=plane, B=plane),
        "HEIF": heif.getvalue(),
        "DNG": dng,
        "JPEG XL DNG": in_jpeg_xl(dng),
    }


KINDS = [
    "JPEG",
    "progressive JPEG",
    "PNG",
    "TIFF",
    "deflated TIFF",
    "tiled TIFF",
    "float TIFF",
    "EXR",
    "HEIF",
    "DNG",
    "JPEG XL DNG",
]


@pytest.mark.parametrize("share", [0.02, 0.3, 0.5, 0.9])
@pytest.mark.parametrize("kind", KINDS)
def test_a_file_cut_off_is_called_damaged(
    every_kind: dict[str, bytes], kind: str, share: float, capfd: pytest.CaptureFixture[str]
) -> None:
    data = every_kind[kind]

    sentence = refusal(data[: max(12, int(share * len(data)))])

    assert "damaged" in sentence
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("kind", KINDS)
def test_a_whole_file_of_the_same_kind_is_read(every_kind: dict[str, bytes], kind: str) -> None:
    assert decode(every_kind[kind]).size == (96, 64)


@pytest.mark.parametrize("kind", ["PNG", "JPEG"])
def test_a_file_with_a_damaged_middle_is_called_damaged(
    every_kind: dict[str, bytes], kind: str
) -> None:
    data = every_kind[kind]
    middle = len(data) // 2

    assert "damaged" in refusal(data[:middle] + bytes(400) + data[middle + 400 :])


@pytest.mark.parametrize(
    "data",
    [
        b"a",
        b"hello, this is no photograph\n" * 50,
        bytes(5000),
        np.random.default_rng(3).bytes(50_000),
        b"GIF89a" + bytes(300),
        b"RIFF\x00\x10\x00\x00WEBPVP8 " + bytes(300),
        b"BM" + bytes(300),
        b"%PDF-1.7\n" + bytes(300),
        b"PK\x03\x04" + bytes(300),
        b"\x00\x00\x00\x20ftypavif" + bytes(300),
    ],
    ids=["a", "text", "zeros", "random", "gif", "webp", "bmp", "pdf", "zip", "avif"],
)
def test_what_is_no_photograph_is_said_to_be_of_no_known_kind(
    data: bytes, capfd: pytest.CaptureFixture[str]
) -> None:
    assert "of a kind that is not read: send a JPEG" in refusal(data)
    assert capfd.readouterr() == ("", "")


def test_an_empty_file_is_said_to_be_empty() -> None:
    assert "is empty" in refusal(b"")
    with pytest.raises(UnreadableImageError, match="is empty"):
        read_header(b"")


@pytest.mark.parametrize("full", [255, 65535, 1.0], ids=["8 bits", "16 bits", "floats"])
@pytest.mark.parametrize("separate", [False, True])
def test_colours_multiplied_by_their_transparency_are_refused(
    codes: Codes, tiff_file: Write, full: float, separate: bool
) -> None:
    """Where nothing is transparent, they are those of the light, as beside other alpha."""
    kind = {255: np.uint8, 65535: np.uint16, 1.0: np.float32}[full]
    light = (codes / 255 * full).astype(kind)

    def file(alpha: float, meaning: str) -> bytes:
        plane = np.full((*codes.shape[:2], 1), full, kind)
        plane[5, 6] = alpha
        values = np.concatenate([light, plane], axis=2)
        stored = np.moveaxis(values, -1, 0) if separate else values
        layout = "separate" if separate else "contig"
        return tiff_file(stored, extrasamples=[meaning], planarconfig=layout)

    sentence = refusal(file(full / 2, "assocalpha"))

    assert "is transparent in places" in sentence
    whole, other = (decode(file(*one)) for one in ((full, "assocalpha"), (0, "unassalpha")))
    np.testing.assert_array_equal(whole.pixels[:], decode(tiff_file(light)).pixels[:])
    light[5, 6] = 0  # what lies below is not shown
    np.testing.assert_array_equal(other.pixels[:], decode(tiff_file(light)).pixels[:])


def test_cmyk_is_refused_with_the_reason(codes: Codes, pillow_file: Write) -> None:
    assert "CMYK" in refusal(pillow_file(codes, "JPEG", "CMYK"))


@pytest.mark.parametrize("size", [(16, 16), (200, 300)])  # LibRaw takes no tiny ones
@pytest.mark.parametrize(
    ("dtype", "planes", "options"),
    [
        (np.uint8, 3, {"photometric": "cielab"}),
        (np.uint8, 3, {"photometric": "ycbcr"}),
        (np.uint8, 1, {"photometric": "miniswhite"}),
        (np.uint32, 3, {}),
        (np.int16, 3, {}),
        (np.uint8, 5, {}),
        (np.uint16, 1, {"photometric": "miniswhite"}),
        (np.uint16, 3, {"photometric": "cielab"}),
        (np.uint16, 1, {"photometric": "mask"}),
        (np.uint16, 1, {"photometric": 32844}),
        (np.uint16, 1, {"photometric": "palette", "colormap": np.zeros((3, 65536), np.uint16)}),
        (np.int16, 1, {"photometric": "minisblack"}),
        (np.float16, 1, {"photometric": "miniswhite"}),
    ],
    ids=[
        "Lab",
        "YCbCr",
        "MinIsWhite",
        "32 bits",
        "signed",
        "five channels",
        "16-bit MinIsWhite",
        "16-bit Lab",
        "mask",
        "LogL",
        "16-bit palette",
        "signed grey",
        "half MinIsWhite",
    ],
)
def test_tiffs_of_other_kinds_are_refused(
    tiff_file: Write,
    dtype: type[Any],
    planes: int,
    options: dict[str, Any],
    size: tuple[int, int],
) -> None:
    """LibRaw would take those of 16 bits for the mosaic of a sensor."""
    values = np.ones((*size, planes), dtype)
    if planes == 1:
        values = values[..., 0]
    assert "a TIFF of a kind that is not read" in refusal(tiff_file(values, **options))


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.int16, np.float16, np.float32])
def test_a_tiff_in_cmyk_is_refused_with_the_reason(tiff_file: Write, dtype: type[Any]) -> None:
    data = tiff_file(np.full((200, 300, 4), 9, dtype), photometric="separated")
    with pytest.raises(UnreadableImageError, match="is in CMYK, the colours of print: save it in"):
        read_header(data)
    assert "is in CMYK" in refusal(data)


def test_a_mosaic_that_says_nothing_of_its_samples_is_taken_as_raw(tiff_file: Write) -> None:
    """As old RAW files do; tifffile alone would call it white as 0."""
    data = bytearray(tiff_file(np.full((200, 300), 900, np.uint16), photometric="minisblack"))
    entry = data.index(struct.pack("<HHI", 262, 3, 1))
    struct.pack_into("<H", data, entry, 261)  # a tag that nobody knows, in its place

    assert read_header(bytes(data)).kind == "RAW"


def test_a_palette_tiff_is_refused(codes: Codes, pillow_file: Write) -> None:
    assert "a TIFF of a kind that is not read" in refusal(pillow_file(codes, "TIFF", "P"))


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e30, -1e30])
def test_float_files_must_hold_light(tiff_file: Write, exr_file: Write, value: float) -> None:
    picture = np.full((8, 8, 3), 0.5, np.float32)
    picture[3, 4, 1] = value
    planes = {name: picture[..., i].copy() for i, name in enumerate("RGB")}

    for data in (tiff_file(picture), exr_file(**planes)):
        assert "values that are no light" in refusal(data)
        assert "values that are no light" in refusal(data, encoding="srgb")


def test_doubles_beyond_floats_are_refused(tiff_file: Write) -> None:
    assert "values that are no light" in refusal(tiff_file(np.full((8, 8, 3), 1e300)))


def test_an_exr_of_integers_is_refused(exr_file: Write) -> None:
    plane = np.ones((8, 8), np.uint32)
    assert "integers" in refusal(exr_file(R=plane, G=plane, B=plane))


@pytest.mark.parametrize("transfer", [16, 18])
def test_hdr_heif_is_refused_with_the_reason(transfer: int) -> None:
    file = io.BytesIO()
    image = pillow_heif.from_bytes("RGB", (64, 64), bytes(64 * 64 * 3))
    image.save(file, color_primaries=9, transfer_characteristics=transfer)

    assert "HDR" in refusal(file.getvalue())


def test_an_avif_that_leaves_its_compression_open_is_of_no_known_kind() -> None:
    data = bytes(imagecodecs.avif_encode(np.full((64, 96, 3), 90, np.uint8)))
    open_brand = data[:8] + b"mif1" + data[12:]

    assert "of a kind that is not read: send a JPEG" in refusal(open_brand)


def test_a_dng_of_a_compression_that_is_not_read_is_not_called_damaged(dng_file: Write) -> None:
    """VC-5, as GoPro writes it."""
    data = bytearray(dng_file(np.full((200, 300), 3000, np.uint16)))
    entry = data.index(struct.pack("<HHI", 259, 3, 1))
    struct.pack_into("<H", data, entry + 8, 9)

    sentence = refusal(bytes(data))

    assert read_header(bytes(data)).kind == "RAW"
    assert "a kind or compression that is not read: convert it to an uncompressed or" in sentence
    assert "damaged" not in sentence


def test_a_dng_that_cannot_even_be_opened_may_be_of_another_compression(tiff_file: Write) -> None:
    """LibRaw knows deflated floats alone."""
    tags = [(50706, "B", 4, (1, 4, 0, 0), True), (50708, "s", 0, "Unheard Of One", True)]
    values = np.full((200, 300), 3000, np.uint16)
    data = tiff_file(values, photometric="cfa", compression="deflate", extratags=tags)

    sentence = refusal(data)

    assert "is a damaged RAW file, or one or a TIFF of a kind that is not read" in sentence
    assert "an uncompressed or lossless DNG of it" in sentence


def test_a_raw_file_cannot_be_srgb(dng_file: Write) -> None:
    data = dng_file(np.full((32, 32), 3000, np.uint16))
    with pytest.raises(OptionError, match="RAW file, which holds linear values"):
        decode(data, "srgb")


BOMB = """
import resource, sys
from pipeline.decode import decode, read_header
from pipeline.errors import ImageTooLargeError, UnreadableImageError
data = sys.stdin.buffer.read()
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
for read in (read_header, decode):
    try:
        read(data)
    except (ImageTooLargeError, UnreadableImageError) as error:
        print(error)
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
"""


def test_a_bomb_is_refused_before_it_takes_memory() -> None:
    bomb = png_bomb(30_000, 30_000)

    run = subprocess.run([sys.executable, "-c", BOMB], input=bomb, capture_output=True, check=True)

    first, second, grown_kb = run.stdout.decode().splitlines()
    assert len(bomb) > 2_000_000
    assert first == second
    assert first.startswith("The no-flash photograph has 30000 × 30000 pixels, more than the limit")
    assert int(grown_kb) < 50_000
    assert run.stderr == b""


def test_a_tiff_of_a_jpeg_that_tells_a_huge_size_takes_no_memory(tiff_file: Write) -> None:
    """Its decoder would make 15,000 × 15,000 pixels for a tile of 64 × 64, mostly in grey."""
    data = tiff_file(np.zeros((64, 64, 3), np.uint8), compression="jpeg", tile=(64, 64))
    size = data.index(b"\xff\xc0") + 5
    bomb = data[:size] + struct.pack(">HH", 15_000, 15_000) + data[size + 4 :]

    run = subprocess.run([sys.executable, "-c", BOMB], input=bomb, capture_output=True, check=True)

    sentence, grown_kb = run.stdout.decode().splitlines()
    assert sentence == (
        "The no-flash photograph is a damaged or incomplete TIFF file: send it again."
    )
    assert int(grown_kb) < 50_000


@pytest.mark.parametrize("kind", ["JPEG", "TIFF", "EXR", "HEIF", "DNG", "JPEG XL DNG", "PNG"])
def test_the_limit_holds_for_every_kind(
    every_kind: dict[str, bytes], kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LIGHTLAYERS_MAX_PIXELS", str(96 * 64 - 1))
    with pytest.raises(ImageTooLargeError, match="96 × 64 pixels"):
        decode(every_kind[kind])
    with pytest.raises(ImageTooLargeError, match="96 × 64 pixels"):
        read_header(every_kind[kind])

    monkeypatch.setenv("LIGHTLAYERS_MAX_PIXELS", str(96 * 64))
    assert read_header(every_kind[kind]).size == (96, 64)


@pytest.mark.parametrize("value", ["many", "-5", "0", "nan"])
def test_a_limit_that_is_no_number_is_an_option_error(
    codes: Codes, pillow_file: Write, value: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LIGHTLAYERS_MAX_PIXELS", value)
    with pytest.raises(OptionError, match="LIGHTLAYERS_MAX_PIXELS"):
        read_header(pillow_file(codes, "PNG"))


@pytest.mark.parametrize(("width", "height"), [(0, 10), (10, 0)])
def test_a_picture_without_pixels_is_damaged(width: int, height: int) -> None:
    assert "damaged" in refusal(png_of(width, height))


def test_a_tiff_of_thousands_of_directories_is_not_walked(tiff_file: Write) -> None:
    """Each directory names the next: 20,000 of them after the picture change nothing."""
    data = bytearray(tiff_file(np.full((8, 8, 3), 0.5, np.float32)))
    (first,) = struct.unpack_from("<I", data, 4)
    (count,) = struct.unpack_from("<H", data, first)
    link = first + 2 + 12 * count
    for _ in range(20_000):
        struct.pack_into("<I", data, link, len(data))
        link = len(data) + 2 + 12
        data += struct.pack("<HHHIHHI", 1, 256, 3, 1, 8, 0, 0)

    assert decode(bytes(data)).size == (8, 8)


@pytest.mark.parametrize("tag", [256, 257])
@pytest.mark.parametrize("count", [0, 3, 200])
def test_a_tiff_whose_size_is_no_number_is_damaged(tiff_file: Write, tag: int, count: int) -> None:
    data = bytearray(tiff_file(np.full((8, 8, 3), 0.5, np.float32)))
    entry = data.index(struct.pack("<HH", tag, 4))
    struct.pack_into("<I", data, entry + 4, count)

    assert "damaged" in refusal(bytes(data))


@pytest.mark.parametrize("share", [0.4, 0.6, 0.97])
@pytest.mark.parametrize(
    "layout", [{"rowsperstrip": 256}, {"rowsperstrip": 16}, {"tile": (64, 64)}]
)
def test_a_tiff_of_jpegs_that_is_cut_off_is_damaged(
    tiff_file: Write, layout: dict[str, Any], share: float
) -> None:
    """Of a JPEG that ends too soon its decoder shows the rest in grey."""
    noise = np.random.default_rng(1).integers(0, 255, (256, 320, 3), dtype=np.uint8)
    data = tiff_file(noise, compression="jpeg", **layout)

    assert decode(data).size == (320, 256)
    assert "damaged" in refusal(data[: int(share * len(data))])


def test_a_tiff_with_a_strip_without_data_is_damaged(tiff_file: Write) -> None:
    file = io.BytesIO(tiff_file(np.full((64, 64, 3), 128, np.uint8), rowsperstrip=16))
    with tifffile.TiffFile(file, mode="r+") as tiff:
        counts = tiff.pages.first.databytecounts
        tiff.pages.first.tags["StripByteCounts"].overwrite([*counts[:-1], 0])

    assert "damaged" in refusal(file.getvalue())

"""What cameras write beside the pixels, sound or broken."""

from __future__ import annotations

import io
import struct
from collections.abc import Callable
from typing import Any

import numpy as np
import pillow_heif
import pytest
import tifffile
from numpy.typing import NDArray
from PIL import Image as PillowImage
from PIL.TiffImagePlugin import IFDRational

from pipeline.decode import decode
from pipeline.decode.metadata import Metadata, read_metadata
from pipeline.images.frames import Exposure
from tests.raw_files import cr3, raf

Write = Callable[..., bytes]
Exif = Callable[..., PillowImage.Exif]

MAIN = {271: "NIKON CORPORATION", 272: "NIKON D5100"}
PHOTO = {
    0x829A: IFDRational(1, 125),
    0x829D: IFDRational(56, 10),
    0x8827: 400,
    0x9209: 0x1F,
    0xA405: 36,
}

EXIF_PLACE = (65000, "I", 1, 0x7EDCBA98, True)
"""Stands for the tag of an EXIF directory, which tifffile does not write."""


@pytest.fixture
def with_exif(
    codes: NDArray[np.uint8], pillow_file: Write, exif_of: Exif
) -> Callable[..., Metadata]:
    """Facts read from a JPEG with these tags."""

    def read(photo: dict[int, Any], main: dict[int, Any] | None = None) -> Metadata:
        return read_metadata(pillow_file(codes, "JPEG", exif=exif_of(main or {}, photo)))

    return read


@pytest.mark.parametrize("kind", ["JPEG", "PNG"])
def test_frames_know_camera_exposure_and_flash(
    codes: NDArray[np.uint8], pillow_file: Write, exif_of: Exif, kind: str
) -> None:
    frame = decode(pillow_file(codes, kind, exif=exif_of(MAIN, PHOTO)))

    assert (frame.make, frame.model) == ("NIKON CORPORATION", "NIKON D5100")
    assert frame.exposure == Exposure(time_s=0.008, iso=400, f_number=5.6)
    assert frame.flash_fired is True
    # the diagonal of 36 × 24 mm is 43.27 mm, that of 64 × 48 pixels 80 pixels
    assert frame.focal_px == pytest.approx(80 * 36 / 43.2666, rel=1e-4)


@pytest.mark.parametrize("mark", [b"", b"Exif\0\0"])
@pytest.mark.parametrize(("mode", "brand"), [("RGB", b"heic"), ("RGB;16", b"heix")])
def test_heif_of_any_depth_and_writer_tells_the_facts(
    codes: NDArray[np.uint8], exif_of: Exif, mode: str, brand: bytes, mark: bytes
) -> None:
    block = exif_of(MAIN, PHOTO).tobytes().removeprefix(b"Exif\0\0")
    values = codes if mode == "RGB" else codes.astype(np.uint16) * 257
    file = io.BytesIO()
    pillow_heif.from_bytes(mode, (64, 48), values.tobytes()).save(file, exif=mark + block)

    frame = decode(file.getvalue())

    assert file.getvalue()[8:12] == brand
    assert (frame.make, frame.model) == ("NIKON CORPORATION", "NIKON D5100")
    assert frame.exposure == Exposure(time_s=0.008, iso=400, f_number=5.6)
    assert frame.flash_fired is True
    assert frame.focal_px == pytest.approx(80 * 36 / 43.2666, rel=1e-4)


def test_raw_files_of_canon_and_fuji_tell_the_facts(
    codes: NDArray[np.uint8], pillow_file: Write, exif_of: Exif
) -> None:
    photo = PHOTO | {0x9003: "1970:01:02 00:00:01", 0xA431: "0123"}
    for data in (
        cr3(photo, MAIN | {274: 6}),
        raf(pillow_file(codes, "JPEG", exif=exif_of(MAIN | {274: 6}, photo))),
    ):
        assert read_metadata(data) == Metadata(
            exposure=Exposure(time_s=0.008, iso=400, f_number=5.6),
            make="NIKON CORPORATION",
            model="NIKON D5100",
            serial="0123",
            flash_fired=True,
            orientation=6,
            focal_35mm=36,
            taken_s=86401.0,
        )


def test_heif_without_a_block_tells_nothing(codes: NDArray[np.uint8]) -> None:
    file = io.BytesIO()
    pillow_heif.from_bytes("RGB", (64, 48), codes.tobytes()).save(file)

    assert read_metadata(file.getvalue()) == Metadata()


def test_tiff_may_hold_the_facts_in_its_main_directory(
    codes: NDArray[np.uint8], tiff_file: Write
) -> None:
    tags = [
        (271, "s", 0, "Canon", True),
        (33434, "2I", 1, (1, 125), True),
        (33437, "2I", 1, (28, 10), True),
        (34855, "H", 1, 100, True),
    ]

    frame = decode(tiff_file(codes, extratags=tags))

    assert frame.make == "Canon"
    assert frame.exposure == Exposure(0.008, 100, 2.8)


def test_a_dng_may_tell_of_flash_and_time_in_its_main_directory(
    dng_file: Write,
) -> None:
    """As TIFF/EP has it; Android writes what it knows of its DNGs there, too."""
    tags = (
        (33434, "2I", 1, (1, 125)),
        (34855, "H", 1, 800),
        (36867, "s", 0, "1970:01:02 00:00:01"),
        (37385, "H", 1, 9),
    )

    found = read_metadata(dng_file(np.full((32, 32), 3000, np.uint16), more=tags))

    assert found.exposure == Exposure(0.008, 800)
    assert found.taken_s == 86401.0
    assert found.flash_fired is True


def with_directory(data: bytes, entries: list[tuple[int, int, int, bytes]], big: bool) -> bytes:
    """Append an EXIF directory to a little-endian TIFF that has a place for its offset."""
    count, entry, inline = ("<Q", "<HHQ", 8) if big else ("<H", "<HHI", 4)
    table, far = struct.pack(count, len(entries)), b""
    size = len(table) + len(entries) * (4 + 2 * inline) + inline
    for code, kind, number, value in entries:
        place = value.ljust(inline, b"\0")
        if len(value) > inline:
            place = (len(data) + size + len(far)).to_bytes(inline, "little")
            far += value
        table += struct.pack(entry, code, kind, number) + place
    return pointing(data, len(data), big) + table + bytes(inline) + far


def pointing(data: bytes, offset: int, big: bool) -> bytes:
    """Make the place for the EXIF directory its tag."""
    number = "<HHQI" if big else "<HHII"
    place = struct.pack(number, EXIF_PLACE[0], 4, 1, EXIF_PLACE[3])
    assert data.count(place) == 1
    return data.replace(place, struct.pack(number, 34665, 4, 1, offset))


@pytest.mark.parametrize("big", [False, True])
def test_tiff_tells_the_facts_of_its_exif_directory(
    codes: NDArray[np.uint8], tiff_file: Write, big: bool
) -> None:
    tags = [(271, "s", 0, "Canon", True), EXIF_PLACE]
    directory = [
        (0x829A, 5, 1, struct.pack("<II", 1, 125)),
        (0x829D, 5, 1, struct.pack("<II", 28, 10)),
        (0x8827, 3, 2, struct.pack("<HH", 400, 400)),
        (0x9003, 2, 20, b"1970:01:02 00:00:01\0"),
        (0x9209, 3, 1, struct.pack("<H", 1)),
        (0x920A, 5, 1, struct.pack("<II", 50, 1)),
        (0x9291, 2, 3, b"25\0"),
        (0xA002, 4, 1, struct.pack("<I", 6000)),
        (0xA20E, 5, 1, struct.pack("<II", 2500, 1)),
        (0xA210, 3, 1, struct.pack("<H", 3)),
        (0xA403, 3, 1, struct.pack("<H", 0)),
        (0xA431, 2, 8, b"1234567\0"),
    ]
    data = tiff_file(codes, bigtiff=big, byteorder="<", extratags=tags)

    facts = read_metadata(with_directory(data, directory, big))

    assert facts == Metadata(
        exposure=Exposure(0.008, 400, 2.8),
        make="Canon",
        serial="1234567",
        flash_fired=True,
        auto_white_balance=True,
        focal_plane=50 * 250 / 6000,
        taken_s=86401.25,
    )


def test_an_exif_directory_of_tiff_with_a_rational_of_nothing(
    codes: NDArray[np.uint8], tiff_file: Write
) -> None:
    data = tiff_file(codes, byteorder="<", extratags=[EXIF_PLACE])
    directory = [(0x829A, 5, 1, bytes(8)), (0x8827, 3, 1, struct.pack("<H", 400))]

    assert read_metadata(with_directory(data, directory, False)).exposure == Exposure(iso=400)


def test_a_tiff_whose_exif_directory_is_nowhere_tells_the_rest(
    codes: NDArray[np.uint8], tiff_file: Write
) -> None:
    tags = [(271, "s", 0, "Canon", True), EXIF_PLACE]
    data = tiff_file(codes, byteorder="<", extratags=tags)

    assert read_metadata(pointing(data, 2**31, False)) == Metadata(make="Canon")


def test_facts_are_those_of_the_picture_that_is_read(codes: NDArray[np.uint8]) -> None:
    """A preview comes first; what the full picture does not say itself, that says for it."""
    file = io.BytesIO()
    with tifffile.TiffWriter(file) as tiff:
        first = [(271, "s", 0, "Canon", True), (274, "H", 1, 3, True)]
        tiff.write(codes[::4, ::4], photometric="rgb", subfiletype=1, extratags=first)
        own = [(272, "s", 0, "EOS R5", True), (274, "H", 1, 6, True)]
        tiff.write(codes, photometric="rgb", extratags=own)

    assert read_metadata(file.getvalue()) == Metadata(make="Canon", model="EOS R5", orientation=6)


@pytest.mark.parametrize("kind", ["JPEG", "PNG", "TIFF"])
def test_nothing_written_means_nothing_known(
    codes: NDArray[np.uint8], pillow_file: Write, kind: str
) -> None:
    frame = decode(pillow_file(codes, kind))

    assert frame.exposure == Exposure()
    assert (frame.make, frame.model, frame.flash_fired) == ("", "", None)
    assert frame.focal_px is None


def test_an_exposure_in_floats_is_read_as_one_in_rationals(
    with_exif: Callable[..., Metadata],
) -> None:
    """No standard has it so, but Pillow makes it of the numbers that programs give it."""
    exposure = with_exif({0x829A: 1 / 125, 0x829D: 5.6, 0x8827: 400}).exposure

    assert exposure == Exposure(time_s=0.008, iso=400, f_number=5.6)
    assert with_exif({0x829A: float("nan")}).exposure.time_s is None


@pytest.mark.parametrize(
    ("value", "fired"), [(0x00, False), (0x10, False), (0x01, True), (0x19, True), (0x50, False)]
)
def test_the_flash_fired_when_bit_0_says_so(
    with_exif: Callable[..., Metadata], value: int, fired: bool
) -> None:
    assert with_exif({0x9209: value}).flash_fired is fired


@pytest.mark.parametrize(("value", "automatic"), [(0, True), (1, False)])
def test_the_white_balance_is_automatic_or_fixed(
    with_exif: Callable[..., Metadata], value: int, automatic: bool
) -> None:
    assert with_exif({0xA403: value}).auto_white_balance is automatic
    assert with_exif({}).auto_white_balance is None


@pytest.mark.parametrize(
    ("unit", "resolution"), [(2, 6350.0), (3, 2500.0), (4, 250.0)], ids=["inch", "cm", "mm"]
)
def test_the_focal_plane_gives_the_focal_length_in_pixels(
    with_exif: Callable[..., Metadata], unit: int, resolution: float
) -> None:
    facts = with_exif(
        {
            0x920A: IFDRational(50, 1),
            0xA20E: IFDRational(int(resolution), 1),
            0xA210: unit,
            0xA002: 6000,
            0xA003: 4000,
        }
    )

    assert facts.focal_px(6000, 4000) == pytest.approx(12_500)
    assert facts.focal_px(1000, 1500) == pytest.approx(3_125), "a smaller copy, turned"


def test_the_equivalent_focal_length_goes_before_the_focal_plane(
    with_exif: Callable[..., Metadata],
) -> None:
    facts = with_exif(
        {0xA405: 72, 0x920A: IFDRational(50, 1), 0xA20E: IFDRational(2500, 1), 0xA002: 6000}
    )

    assert facts.focal_px(4000, 6000) == pytest.approx(12_000)


@pytest.mark.parametrize(
    ("tag", "value"),
    [
        (0x829A, IFDRational(0, 1)),
        (0x829A, IFDRational(1, 0)),
        (0x829A, IFDRational(0, 0)),
        (0x829A, IFDRational(4_000_000_000, 1)),
        (0x829D, IFDRational(0, 1)),
        (0x829D, IFDRational(5000, 1)),
        (0x8827, 0),
        (0xA405, 0),
        (0xA405, 65535),
    ],
)
def test_absurd_values_count_as_unknown(
    with_exif: Callable[..., Metadata], tag: int, value: object
) -> None:
    facts = with_exif({**PHOTO, tag: value})

    expected = {
        0x829A: Exposure(None, 400, 5.6),
        0x829D: Exposure(0.008, 400, None),
        0x8827: Exposure(0.008, None, 5.6),
    }.get(tag, Exposure(0.008, 400, 5.6))
    assert facts.exposure == expected
    assert facts.focal_35mm == (None if tag == 0xA405 else 36)


@pytest.mark.parametrize("orientation", [0, 9, 65535])
def test_an_orientation_that_does_not_exist_is_upright(
    with_exif: Callable[..., Metadata], orientation: int
) -> None:
    assert with_exif({}, {274: orientation}).orientation == 1


def test_names_are_short_and_printable(with_exif: Callable[..., Metadata]) -> None:
    facts = with_exif({}, {271: "  ACME\n\x07 ", 272: "X" * 5000})

    assert facts.make == "ACME"
    assert facts.model == "X" * 64


@pytest.mark.parametrize("at", range(30, 130, 7))
def test_a_broken_block_is_no_reason_to_refuse(
    codes: NDArray[np.uint8],
    pillow_file: Write,
    exif_of: Exif,
    at: int,
    capfd: pytest.CaptureFixture[str],
) -> None:
    data = bytearray(pillow_file(codes, "JPEG", exif=exif_of(MAIN, PHOTO)))
    data[at : at + 7] = b"\xff" * 7

    assert decode(bytes(data)).pixels.shape == (48, 64, 3)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\xff\xd8\xff",
        b"II*\0\xff\xff\xff\xff",
        b"\0\0\0\x14ftypheix",
        bytes(100),
        b"\0\0\0\0ftypcrx " + bytes(64),
        cr3(PHOTO)[:100],
        b"FUJIFILMCCD-RAW 0201",
        raf(b"no JPEG"),
    ],
)
def test_bytes_without_facts_give_none(data: bytes) -> None:
    assert read_metadata(data) == Metadata()


@pytest.mark.parametrize(
    ("photo", "seconds"),
    [
        ({0x9003: "1970:01:02 00:00:01", 0x9291: "25"}, 86401.25),
        ({0x9003: "1970:01:02 00:00:01"}, 86401.0),
        ({0x9003: "1970:01:02 00:00:01", 0x9291: "soon"}, 86401.0),
        ({0x9003: "0000:00:00 00:00:00"}, None),
        ({0x9003: "1970:01:02"}, None),
        ({}, None),
    ],
)
def test_the_moment_is_that_of_the_cameras_clock(
    with_exif: Callable[..., Metadata], photo: dict[int, Any], seconds: float | None
) -> None:
    assert with_exif(photo).taken_s == seconds


@pytest.mark.parametrize(
    ("photo", "expected"),
    [
        ({0x9201: IFDRational(7, 1), 0x9202: IFDRational(5, 1)}, Exposure(1 / 128, None, 2**2.5)),
        ({0x829A: IFDRational(0, 1), 0x9201: IFDRational(-2, 1)}, Exposure(4.0)),
        ({0x829A: IFDRational(1, 60), 0x9201: IFDRational(7, 1)}, Exposure(1 / 60)),
        ({0x9201: IFDRational(0, 1), 0x9202: IFDRational(0, 1)}, Exposure()),
        ({0x9201: IFDRational(-1000, 1), 0x9202: IFDRational(10**6, 1)}, Exposure()),
        ({0x8827: 65535, 0x8832: 102400}, Exposure(iso=102400)),
        ({0x8827: 65535, 0x8831: 204800}, Exposure(iso=204800)),
        ({0x8827: 65535}, Exposure()),
        ({0x8827: 0, 0x8833: 400}, Exposure(iso=400)),
        ({0x8827: 200, 0x8832: 400}, Exposure(iso=200)),
    ],
)
def test_the_exposure_is_found_in_the_tags_that_stand_in_for_the_usual(
    with_exif: Callable[..., Metadata], photo: dict[int, Any], expected: Exposure
) -> None:
    found = with_exif(photo).exposure

    assert (found.iso, found.f_number) == (expected.iso, expected.f_number)
    assert found.time_s == (expected.time_s and pytest.approx(expected.time_s))


def test_tiff_may_tell_its_exposure_in_apex_values(
    codes: NDArray[np.uint8], tiff_file: Write
) -> None:
    directory = [
        (0x9201, 10, 1, struct.pack("<ii", 7, 1)),
        (0x9202, 5, 1, struct.pack("<II", 4, 1)),
    ]
    data = tiff_file(codes, byteorder="<", extratags=[EXIF_PLACE])

    assert read_metadata(with_directory(data, directory, False)).exposure == Exposure(
        1 / 128, None, 4.0
    )


def segment(kind: int, payload: bytes) -> bytes:
    return struct.pack(">BBH", 0xFF, kind, len(payload) + 2) + payload


@pytest.mark.parametrize(
    "before",
    [
        segment(0xE1, b"http://ns.adobe.com/xap/1.0/\0<x/>")
        + segment(0xE1, b"http://ns.adobe.com/xmp/extension/\0" + bytes(60000)) * 3,
        segment(0xE2, b"MPF\0" + bytes(6000)),
        b"".join(
            segment(0xE2, b"ICC_PROFILE\0" + bytes([number, 12]) + bytes(500))
            for number in range(1, 13)
        ),
        b"\xff\xff",
    ],
    ids=["XMP", "MPF", "ICC", "fill bytes"],
)
def test_the_facts_of_a_jpeg_are_found_behind_other_segments(
    codes: NDArray[np.uint8], pillow_file: Write, exif_of: Exif, before: bytes
) -> None:
    block = b"Exif\0\0" + exif_of({274: 6}, PHOTO).tobytes().removeprefix(b"Exif\0\0")
    plain = pillow_file(codes, "JPEG")

    frame = decode(plain[:2] + before + segment(0xE1, block) + plain[2:])

    assert frame.exposure == Exposure(0.008, 400, 5.6)
    assert frame.size == (48, 64)

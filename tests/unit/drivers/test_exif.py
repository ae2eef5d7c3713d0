from __future__ import annotations

import io
from collections.abc import Mapping
from fractions import Fraction

import pytest
from PIL import Image
from PIL.TiffImagePlugin import IFDRational

from drivers.errors import PairVerificationError
from drivers.exif import ExposureFacts, read_exposure
from tests.raw_files import cr3, raf

SOUND = {0x829A: IFDRational(1, 125), 0x829D: IFDRational(28, 10), 0x8827: 400, 0x9209: 0x09}


def jpeg(tags: Mapping[int, object]) -> bytes:
    exif = Image.Exif()
    exif.get_ifd(0x8769).update(tags)
    file = io.BytesIO()
    Image.new("RGB", (8, 8)).save(file, "JPEG", exif=exif)
    return file.getvalue()


def test_the_exposure_is_read_exactly() -> None:
    expected = ExposureFacts(Fraction(1, 125), Fraction(14, 5), 400, flash_fired=True)
    assert read_exposure(jpeg(SOUND)) == expected


def test_raw_files_of_canon_and_fuji_tell_their_exposure_where_no_tiff_reader_looks() -> None:
    expected = ExposureFacts(Fraction(1, 125), Fraction(14, 5), 400, flash_fired=True)
    assert read_exposure(cr3(SOUND)) == expected
    assert read_exposure(raf(jpeg(SOUND))) == expected


def test_an_empty_box_is_no_end_of_what_canon_writes() -> None:
    photograph, empty = cr3(SOUND), b"\0\0\0\x08free"
    first = int.from_bytes(photograph[:4], "big")

    found = read_exposure(photograph[:first] + empty + photograph[first:])

    assert found == read_exposure(photograph)


@pytest.mark.parametrize(
    "photograph",
    [
        cr3(SOUND).replace(b"CMT2", b"CMT9"),
        cr3(SOUND).replace(b"moov", b"free"),
        cr3(SOUND)[:100],
        b"\0\0\0\0ftypcrx " + bytes(64),
        raf(jpeg(SOUND))[:86],
        raf(jpeg(SOUND))[:180],
        raf(b"no JPEG"),
    ],
)
def test_damaged_raw_files_of_canon_and_fuji_are_refused(photograph: bytes) -> None:
    with pytest.raises(PairVerificationError, match="cannot be checked"):
        read_exposure(photograph)


@pytest.mark.parametrize(
    ("flash", "fired"), [(0, False), (1, True), (0x10, False), (0x18, False), (0x5F, True)]
)
def test_only_the_lowest_bit_tells_of_the_flash(flash: int, fired: bool) -> None:
    assert read_exposure(jpeg({**SOUND, 0x9209: flash})).flash_fired is fired


@pytest.mark.parametrize(
    ("tag", "name"),
    [(0x829A, "ExposureTime"), (0x8827, "ISOSpeed"), (0x9209, "Flash")],
)
def test_a_missing_tag_is_named(tag: int, name: str) -> None:
    tags = {key: value for key, value in SOUND.items() if key != tag}
    with pytest.raises(
        PairVerificationError, match=f"without {name}.*: take the two photographs by"
    ):
        read_exposure(jpeg(tags))


@pytest.mark.parametrize("value", [None, IFDRational(0, 0), IFDRational(0, 1)])
def test_a_lens_may_tell_the_camera_no_aperture(value: IFDRational | None) -> None:
    tags = {key: each for key, each in {**SOUND, 0x829D: value}.items() if each is not None}
    found = read_exposure(jpeg(tags))
    assert found == ExposureFacts(Fraction(1, 125), None, 400, flash_fired=True)


@pytest.mark.parametrize(
    ("tag", "value"),
    [(0x829A, IFDRational(1, 0)), (0x8827, "fast")],
)
def test_values_that_are_no_numbers_count_as_missing(tag: int, value: object) -> None:
    with pytest.raises(PairVerificationError, match="cannot be checked"):
        read_exposure(jpeg({**SOUND, tag: value}))


@pytest.mark.parametrize(
    "photograph", [b"", b"text", b"\xff\xd8\xff\xe1\xff\xff", b"II*\0\xff\xff\xff\xff", bytes(64)]
)
def test_bytes_without_exif_are_refused(photograph: bytes) -> None:
    with pytest.raises(PairVerificationError, match="cannot be checked"):
        read_exposure(photograph)


def test_a_cut_photograph_is_refused() -> None:
    whole = jpeg(SOUND)
    with pytest.raises(PairVerificationError, match="cannot be checked"):
        read_exposure(whole[: whole.index(b"Exif") + 30])

from __future__ import annotations

import pytest

from pipeline.decode.signatures import Kind, kind_of


@pytest.mark.parametrize(
    ("head", "kind"),
    [
        (b"\xff\xd8\xff\xe1", "JPEG"),
        (b"\x89PNG\r\n\x1a\n", "PNG"),
        (b"\x76\x2f\x31\x01", "EXR"),
        (b"II*\x00\x08\x00\x00\x00\x00\x00", "TIFF"),
        (b"MM\x00*\x00\x00\x00\x08\x00\x00", "TIFF"),
        (b"II+\x00\x08\x00\x00\x00\x00\x00", "TIFF"),
        (b"II*\x00\x10\x00\x00\x00CR\x02\x00", "RAW"),
        (b"\x00\x00\x00\x18ftypcrx ", "RAW"),
        (b"\x00\x00\x00\x18ftypheic", "HEIF"),
        (b"\x00\x00\x00\x18ftypmif1", "HEIF"),
        (b"FUJIFILMCCD-RAW 0201", "RAW"),
        (b"IIU\x00\x18\x00\x00\x00", "RAW"),
        (b"IIRO\x08\x00\x00\x00", "RAW"),
        (b"\x00\x00\x00\x18ftypmif1\0\0\0\0mif1heic", "HEIF"),
        (b"\x00\x00\x00\x1cftypmif1\0\0\0\0mif1avifheic", "HEIF"),
        (b"\x00\x00\x00\x14ftypmif1\0\0\0\0miafavif", "HEIF"),  # which is of the next box
        (b"\xff\xff\xff\xffftypmif1", "HEIF"),
        (b"\x00\x00\x00\x18ftypmif1\0\0\0\0avifmif1", None),
        (b"\x00\x00\x00\x18ftypmsf1\0\0\0\0msf1avis", None),
        (b"\x00\x00\x00\x18ftypavif", None),
        (b"\x00\x00\x00\x18ftypmp42", None),
        (b"GIF89a", None),
        (b"\xff\xd8", None),
        (b"", None),
    ],
)
def test_the_first_bytes_tell_the_kind(head: bytes, kind: Kind | None) -> None:
    assert kind_of(head) == kind

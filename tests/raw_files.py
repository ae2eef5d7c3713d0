"""RAW files as far as their EXIF goes, where no TIFF reader finds it: there are no pixels in them.

Sources: libopenraw's description of RAF; Laurent Clévy's of CR3.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping

from PIL import Image

_CANON = bytes.fromhex("85c0b687820f11e08111f4ce462b6a48")
_PREVIEW = bytes.fromhex("eaf42b5e1c984b88b9fbb7dc406e4d16")


def raf(jpeg: bytes) -> bytes:
    """Fuji's RAF around a JPEG that has the EXIF."""
    head = b"FUJIFILMCCD-RAW 0201FF383501X-T3".ljust(84, b"\0")
    return (head + struct.pack(">II", 160, len(jpeg))).ljust(160, b"\0") + jpeg + bytes(1000)


def cr3(exif: Mapping[int, object], image: Mapping[int, object] | None = None) -> bytes:
    """Canon's CR3 with these tags of the EXIF directory, and those of the first one."""
    facts = _box(b"CNCV", b"CanonCR3_001/00.09.00/00.00.00")
    facts += _box(b"CMT1", _tiff(image or {})) + _box(b"CMT2", _tiff(exif))
    movie = _box(b"uuid", _CANON + facts) + _box(b"mvhd", bytes(100))
    return b"".join(
        (
            _box(b"ftyp", b"crx \0\0\0\1crx isom"),
            _box(b"moov", movie),
            _box(b"uuid", _PREVIEW + bytes(64)),
            struct.pack(">I4sQ", 1, b"mdat", 16 + 1000) + bytes(1000),
        )
    )


def _box(name: bytes, data: bytes) -> bytes:
    return struct.pack(">I", 8 + len(data)) + name + data


def _tiff(tags: Mapping[int, object]) -> bytes:
    exif = Image.Exif()
    exif.update(tags)
    return exif.tobytes().removeprefix(b"Exif\0\0")

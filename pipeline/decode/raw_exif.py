"""EXIF of the RAW files where no TIFF reader finds it: Fuji's RAF and Canon's CR3.

drivers.exif has this for itself: neither package imports the other. Sources: libopenraw's
description of RAF; Laurent Clévy's of CR3.
"""

from __future__ import annotations

import struct

from pipeline.decode.boxes import box

_CANON = bytes.fromhex("85c0b687820f11e08111f4ce462b6a48")


def raf_jpeg(data: bytes) -> bytes | None:
    """Give the JPEG with the EXIF of a RAF, None for another file. Raises struct.error."""
    if not data.startswith(b"FUJIFILMCCD-RAW"):
        return None
    start, size = struct.unpack_from(">II", data, 84)
    return data[start : start + size]


def cr3_directories(data: bytes) -> tuple[bytes, bytes] | None:
    """Give the first and the EXIF directory of a CR3, each as a TIFF; None for another file."""
    if data[4:12] != b"ftypcrx ":
        return None
    facts = box(box(data, b"moov"), b"uuid" + _CANON)
    return box(facts, b"CMT1"), box(facts, b"CMT2")

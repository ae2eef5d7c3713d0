"""What the manifest says of a file."""

from __future__ import annotations

import hashlib
import struct
from pathlib import Path

import OpenEXR
import tifffile

from pipeline.decode.rendered import jpeg_size, png_size
from pipeline.images.data_window import size_of_window

_HEAD = 65536
"""Bytes that hold the header of a JPEG or PNG that was written here."""

_PSD_SIZE_AT = 14  # bytes from the beginning: height, then width


def describe(path: Path, encoding: str, colour_space: str) -> dict[str, str | int]:
    """Name, SHA-256, encoding, colour space of a written file; of a picture, width and height.

    encoding, colour_space: words for people and programs, passed through. Raises OSError.
    """
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
        file.seek(0)
        head = file.read(_HEAD)
    entry: dict[str, str | int] = {
        "name": path.name,
        "sha256": digest,
        "encoding": encoding,
        "colour_space": colour_space,
    }
    return entry | dict(zip(("width", "height"), _size(path, head), strict=False))


def _size(path: Path, head: bytes) -> tuple[int, ...]:
    if path.suffix == ".glb":
        return ()
    if path.suffix == ".exr":
        header = OpenEXR.File(str(path), header_only=True).header()
        return size_of_window(*header["dataWindow"])
    if path.suffix == ".psd":
        height, width = struct.unpack_from(">II", head, _PSD_SIZE_AT)
        return width, height
    if path.suffix == ".tif":
        with tifffile.TiffFile(path) as tiff:
            page = tiff.pages.first
            return page.imagewidth, page.imagelength
    return (png_size if path.suffix == ".png" else jpeg_size)(head)

"""What the manifest says of a file."""

from __future__ import annotations

import hashlib
from pathlib import Path

import OpenEXR
import tifffile

from pipeline.decode.rendered import jpeg_size, png_size


def describe(path: Path, encoding: str, colour_space: str) -> dict[str, str | int]:
    """Name, SHA-256, encoding, colour space, width and height of a written picture.

    encoding, colour_space: words for people and programs, passed through. Raises OSError.
    """
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    width, height = _size(path)
    return {
        "name": path.name,
        "sha256": digest,
        "encoding": encoding,
        "colour_space": colour_space,
        "width": width,
        "height": height,
    }


def _size(path: Path) -> tuple[int, int]:
    if path.suffix == ".exr":
        (left, top), (right, bottom) = OpenEXR.File(str(path), header_only=True).header()[
            "dataWindow"
        ]
        return int(right - left) + 1, int(bottom - top) + 1
    if path.suffix == ".tif":
        with tifffile.TiffFile(path) as tiff:
            page = tiff.pages.first
            return page.imagewidth, page.imagelength
    return (png_size if path.suffix == ".png" else jpeg_size)(path.read_bytes())

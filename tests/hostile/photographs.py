"""Small pairs in every format that is read, and some that are not; and how to damage them."""

from __future__ import annotations

import io
import random
import struct
import tempfile
from pathlib import Path

import numpy as np
import numpy.typing as npt
import OpenEXR
import pillow_heif
import tifffile
from PIL import Image

import drivers

Pair = tuple[bytes, bytes]
Picture = npt.NDArray[np.float32]

_WIDTH, _HEIGHT = 64, 48
_HEAD_BYTES = 600
_ABSURD = (0, 1, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF)


def pairs() -> dict[str, Pair]:
    """A good pair of each format, by its name."""
    before, after = _scene(), _scene(flash=0.5)
    with drivers.open_camera("sim://studio?lights=2&width=96&height=64") as camera:
        shot = drivers.capture_pair(camera)
    return {
        "jpeg": (_pillow(before, "JPEG"), _pillow(after, "JPEG")),
        "png": (_pillow(before, "PNG"), _pillow(after, "PNG")),
        "webp": (_pillow(before, "WEBP"), _pillow(after, "WEBP")),
        "gif": (_pillow(before, "GIF"), _pillow(after, "GIF")),
        "tiff": (_tiff(before, "uint16", None), _tiff(after, "uint16", None)),
        "packed tiff": (_tiff(before, "uint8", "zlib"), _tiff(after, "uint8", "zlib")),
        "float tiff": (_tiff(before, "float32", None), _tiff(after, "float32", None)),
        "exr": (_exr(before), _exr(after)),
        "heic": (heic(before), heic(after)),
        "dng": (shot.no_flash.best, shot.flash.best),
    }


def heic(picture: Picture) -> bytes:
    """Write a picture (H×W×3, 0…1) as phones do."""
    codes = _codes(picture)
    image = pillow_heif.from_bytes("RGB", (codes.shape[1], codes.shape[0]), codes.tobytes())
    file = io.BytesIO()
    image.save(file, quality=90)
    return file.getvalue()


def damage(chance: random.Random, data: bytes) -> bytes:
    """Change a file as storms, disks and enemies do; mostly where its head is."""
    kind = chance.randrange(8)
    if kind == 0:
        return data[: chance.randrange(len(data))]
    if kind == 1:
        return chance.randbytes(chance.randrange(1, 400)) + data
    if kind == 2:
        start = chance.randrange(len(data))
        return data[:start] + data[start + chance.randrange(1, 200) :]
    changed = bytearray(data)
    reach = len(data) if kind == 3 else min(_HEAD_BYTES, len(data))
    for _ in range(chance.choice((1, 2, 5, 20, 100))):
        place = chance.randrange(reach)
        if kind < 6:
            changed[place] ^= 1 << chance.randrange(8)
        else:
            order = chance.choice("<>")
            number = struct.pack(f"{order}I", chance.choice(_ABSURD))
            size = chance.choice((1, 2, 4))
            changed[place : place + size] = number[:size] if order == "<" else number[-size:]
    return bytes(changed)


def _scene(flash: float = 0.0) -> Picture:
    y, x = np.mgrid[0 : 1 : _HEIGHT * 1j, 0 : 1 : _WIDTH * 1j]
    shade = 0.5 + 0.4 * np.sin(9 * x) * np.cos(7 * y)
    warm, cool = np.array([1.0, 0.7, 0.4]), np.array([0.5, 0.7, 1.0])
    lamps = (1 - x)[..., None] * warm + x[..., None] * cool
    return np.asarray(0.45 * shade[..., None] * (lamps + flash), np.float32)


def _codes(picture: Picture) -> npt.NDArray[np.uint8]:
    return np.asarray(np.round(np.clip(picture, 0, 1) * 255), np.uint8)


def _pillow(picture: Picture, kind: str) -> bytes:
    file = io.BytesIO()
    Image.fromarray(_codes(picture)).save(file, kind)
    return file.getvalue()


def _tiff(picture: Picture, dtype: str, compression: str | None) -> bytes:
    peak = np.iinfo(dtype).max if dtype.startswith("u") else 1
    file = io.BytesIO()
    values = (np.clip(picture, 0, 1) * peak).astype(dtype)
    tifffile.imwrite(file, values, photometric="rgb", compression=compression)
    return file.getvalue()


def _exr(picture: Picture) -> bytes:
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "picture.exr"
        OpenEXR.File(header, {"RGB": np.ascontiguousarray(picture)}).write(str(path))
        return path.read_bytes()

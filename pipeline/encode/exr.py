from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import Imath
import numpy as np
import OpenEXR
from numpy.typing import NDArray

from pipeline.decode.quiet import muted
from pipeline.encode.half_floats import to_half
from pipeline.errors import InputError

_FLOAT = Imath.Channel(Imath.PixelType(Imath.PixelType.FLOAT))
_HALF = Imath.Channel(Imath.PixelType(Imath.PixelType.HALF))
_TOLD = (
    errno.ENOSPC,
    errno.EDQUOT,
    errno.EFBIG,
    errno.EMFILE,
    errno.ENOENT,
    errno.EACCES,
    errno.EPERM,
    errno.EISDIR,
    errno.ENOTDIR,
    errno.EROFS,
    errno.ENAMETOOLONG,
)
"""What OpenEXR may tell in words of a place that cannot be written."""


class ExrFile:
    """An EXR written from top to bottom, some rows after the others.

    Plain scan lines: docs/decisions/0011-uncompressed-layers.md. size: (width, height). half: of
    16-bit floats, as light is written; else of 32-bit floats. OpenEXR's newer interface takes whole
    pictures only, which need far more memory. Raises InputError as name_of does.
    """

    def __init__(self, path: Path, size: tuple[int, int], half: bool = False) -> None:
        self._name = name_of(path)
        self._size = size
        self._channel = _HALF if half else _FLOAT
        self._half = half
        self._file: OpenEXR.OutputFile | None = None

    def write(self, pictures: dict[str, NDArray[np.float32]]) -> None:
        """Write the next rows.

        pictures: planes (h, W), each the channel of its name, and pictures (h, W, 3), the channels
        name.R, name.G and name.B, or R, G and B if the name is RGB; the same names each time.
        Raises ValueError for pictures of different size, OSError where nothing can be written, with
        an errno as of Python's own files.
        """
        channels = channels_of(pictures)
        rows = len(next(iter(channels.values())))
        lines = {
            name: to_half(plane) if self._half else np.ascontiguousarray(plane)
            for name, plane in channels.items()
        }
        with _errors_numbered():
            if self._file is None:
                header = OpenEXR.Header(*self._size)
                header["compression"] = Imath.Compression(Imath.Compression.NO_COMPRESSION)
                header["channels"] = dict.fromkeys(channels, self._channel)
                self._file = OpenEXR.OutputFile(self._name, header)
            self._file.writePixels(lines, rows)

    def close(self) -> None:
        """End the file, of which all rows are written. Raises OSError where it is not whole."""
        if self._file is not None:
            self._file.close()
            _check_whole(self._name, self._size[1])


def name_of(path: Path) -> str:
    """Name of a file for OpenEXR, which crashes over one that is not UTF-8. Raises InputError."""
    name = str(path)
    try:
        name.encode()
    except UnicodeEncodeError as error:
        raise InputError(
            f"EXR files cannot be at {name!a}: the name is not UTF-8, so rename the folder."
        ) from error
    return name


def channels_of(pictures: dict[str, NDArray[np.float32]]) -> dict[str, NDArray[np.float32]]:
    """Planes (h, W) by the names of their channels, of what ExrFile takes; it says the rest."""
    if len({picture.shape[:2] for picture in pictures.values()}) != 1:
        raise ValueError("the channels of an EXR must have one size")
    channels: dict[str, NDArray[np.float32]] = {}
    for name, picture in pictures.items():
        if picture.ndim == 2:
            channels[name] = picture
            continue
        prefix = "" if name == "RGB" else f"{name}."
        channels |= {f"{prefix}{letter}": picture[..., k] for k, letter in enumerate("RGB")}
    return channels


@contextmanager
def _errors_numbered() -> Iterator[None]:
    """Give OSErrors the errno that OpenEXR tells in words alone."""
    try:
        yield
    except OSError as error:
        for number in _TOLD:
            if error.errno is None and os.strerror(number) in str(error):
                raise OSError(number, os.strerror(number)) from error
        raise


def _check_whole(name: str, height: int) -> None:
    """Raise OSError for a file without its table of rows or its last row.

    OpenEXR says nothing where it cannot write at last what its buffer still holds.
    """
    try:
        with muted(), closing(OpenEXR.InputFile(name)) as file:
            whole = file.isComplete()
            one, kind = next(iter(file.header()["channels"].items()))
            file.channel(one, kind.type, height - 1, height - 1)
    except Exception:  # OpenEXR raises what it likes
        whole = False
    if not whole:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), name)


def write_exr(path: Path, pictures: dict[str, NDArray[np.float32]]) -> None:
    """Write whole pictures, as ExrFile does. Raises what it raises."""
    height, width = next(iter(pictures.values())).shape[:2]
    file = ExrFile(path, (width, height))
    file.write(pictures)
    file.close()

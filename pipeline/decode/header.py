"""What a file says of its picture before it is decoded, and how a pair of them is read alike."""

from __future__ import annotations

from dataclasses import dataclass, replace

from pipeline.decode.samples import turns_sides
from pipeline.decode.signatures import Kind


@dataclass(frozen=True)
class Header:
    """kind: of file. size: (width, height) after orientation, in pixels.

    orientation: 1–8 as EXIF 2.32 defines it, by which the sensor's picture is turned upright.
    place: (x, y) of the first pixel within what is shown, for an EXR may hold a part of it alone.
    """

    kind: Kind
    size: tuple[int, int]
    orientation: int = 1
    place: tuple[int, int] = (0, 0)

    @property
    def stored(self) -> tuple[int, int]:
        """(width, height) before orientation."""
        return self.size[::-1] if turns_sides(self.orientation) else self.size


def read_alike(no_flash: Header, flash: Header) -> Header:
    """Header of the flash photograph as it is to be read: turned as the other of its pair.

    A camera that looks down, or lies flat, may write another orientation though it did not move.
    Where kinds or sizes before orientation differ, a converter may have turned one: left as it is.
    """
    if no_flash.kind != flash.kind or no_flash.stored != flash.stored:
        return flash
    return replace(flash, size=no_flash.size, orientation=no_flash.orientation)

"""Pixels as a file holds them, before they become linear light."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.images.frames import Mask

_PQ, _HLG = 16, 18
"""Transfer characteristics of Rec. ITU-T H.273."""
HDR = (
    "is an HDR picture (PQ or HLG), whose values follow no camera's curve: send the RAW file, or "
    "switch HDR off in the camera."
)
CMYK = "is in CMYK, the colours of print: save it in RGB."
"""What UnsuitableError says of such files."""


class UnsuitableError(ValueError):
    """A sound file of no use here; the message goes on from "The photograph …" to what to do."""


@dataclass(frozen=True)
class Samples:
    """Decoded samples of one picture.

    values: uint8, uint16 or float32, (H, W, 3), upright unless orientation says otherwise.
    white: the code value that means 1.0.
    orientation: EXIF orientation (1–8) still to be applied.
    profile: ICC profile of the values, None where the file has none.
    empty: (H, W) as the values lie, true where they show nothing; None where all show something.
    """

    values: NDArray[Any]
    white: float
    orientation: int = 1
    profile: bytes | None = None
    empty: Mask | None = None


def refuse_hdr(transfer: int | None) -> None:
    """Raise UnsuitableError for PQ and HLG, by their transfer characteristics in H.273."""
    if transfer in (_PQ, _HLG):
        raise UnsuitableError(HDR)


def refuse_grey(channels: int) -> None:
    """Raise UnsuitableError for a picture of one channel, or of one and alpha."""
    if channels < 3:
        raise UnsuitableError(
            "is grey, but lamps are told apart by their colours: send a colour photograph."
        )


def refuse_premultiplied(alpha: NDArray[Any], opaque: float) -> None:
    """Raise UnsuitableError where an alpha (H, W) that colours are multiplied by is not opaque."""
    if (alpha != opaque).any():
        raise UnsuitableError(
            "is transparent in places, and its colours are multiplied by that: save it without an "
            "alpha channel."
        )


def transparent(values: NDArray[Any]) -> Mask | None:
    """Pixels (H, W) whose alpha, the fourth channel that colours are not multiplied by, is 0.

    None where there are none, and where all are: whoever wrote that gave it no meaning.
    """
    if values.ndim != 3 or values.shape[2] != 4:
        return None
    nothing = np.asarray(values[..., 3] == 0)
    return nothing if nothing.any() and not nothing.all() else None


def to_rgb(values: NDArray[Any]) -> NDArray[Any]:
    """(H, W, 3 or 4) → (H, W, 3), a view without alpha.

    Raises UnsuitableError for grey pictures, ValueError for other shapes.
    """
    if values.ndim in (2, 3):
        refuse_grey(values.shape[2] if values.ndim == 3 else 1)
    if values.ndim != 3 or values.shape[2] not in (3, 4):
        raise ValueError(f"{values.shape} is no picture")
    return values[..., :3]


def turns_sides(orientation: int) -> bool:
    """Whether an EXIF orientation makes a picture's width its height."""
    return orientation >= 5


def inverse(orientation: int) -> int:
    """EXIF orientation that takes the turn of another back."""
    return {6: 8, 8: 6}.get(orientation, orientation)


def upright(values: NDArray[Any], orientation: int) -> NDArray[Any]:
    """Turn (H, W, …) as EXIF 2.32 (tag 0x0112) says; a view, the size swapped for 5 to 8."""
    if turns_sides(orientation):
        values = values.swapaxes(0, 1)
    if orientation in (3, 4, 7, 8):
        values = values[::-1]
    if orientation in (2, 3, 6, 7):
        values = values[:, ::-1]
    return values

"""Words on pictures that explain results."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.uint8]
Box = tuple[int, int, int, int]
"""Left, top, right and bottom pixel."""

BACKGROUND, INK = (28, 28, 30), (235, 235, 235)

_FONT, _SIZE = cv2.FONT_HERSHEY_SIMPLEX, 0.6
_PAD = 5  # of a box about its text


def panel(height: int, width: int) -> Picture:
    """An empty 8-bit picture (height, width, 3)."""
    return np.full((height, width, 3), BACKGROUND, dtype=np.uint8)


def write(
    picture: Picture, text: str, at: tuple[int, int], colour: tuple[int, int, int] = INK
) -> None:
    """Write a line of text; at: x of its left end, y of its base line."""
    cv2.putText(picture, text, at, _FONT, _SIZE, colour, 1, cv2.LINE_AA)


def box_of(text: str, at: tuple[int, int], width: int) -> Box:
    """Where write_boxed draws: centred at (x, y), pushed inside 0 … width."""
    (length, height), _ = cv2.getTextSize(text, _FONT, _SIZE, 1)
    x = min(max(at[0] - length // 2, 8), width - length - 8)
    y = at[1] + height // 2
    return x - _PAD, y - height - _PAD, x + length + _PAD, y + _PAD + 1


def write_boxed(picture: Picture, text: str, at: tuple[int, int], width: int) -> None:
    """Write a line centred at (x, y) on a dark box, pushed inside 0 … width. No text, no box."""
    if not text:
        return
    left, top, right, bottom = box_of(text, at, width)
    cv2.rectangle(picture, (left, top), (right, bottom), BACKGROUND, -1)
    write(picture, text, (left + _PAD, bottom - _PAD - 1))


def overlap(one: Box, other: Box) -> bool:
    """Whether two boxes have pixels in common."""
    return one[0] <= other[2] and other[0] <= one[2] and one[1] <= other[3] and other[1] <= one[3]

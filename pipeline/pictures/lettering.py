"""Words on pictures that explain results."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.uint8]

BACKGROUND, INK = (28, 28, 30), (235, 235, 235)

_FONT, _SIZE = cv2.FONT_HERSHEY_SIMPLEX, 0.6


def panel(height: int, width: int) -> Picture:
    """An empty 8-bit picture (height, width, 3)."""
    return np.full((height, width, 3), BACKGROUND, dtype=np.uint8)


def write(
    picture: Picture, text: str, at: tuple[int, int], colour: tuple[int, int, int] = INK
) -> None:
    """Write a line of text; at: x of its left end, y of its base line."""
    cv2.putText(picture, text, at, _FONT, _SIZE, colour, 1, cv2.LINE_AA)


def write_boxed(picture: Picture, text: str, at: tuple[int, int], width: int) -> None:
    """Write a line centred at (x, y) on a dark box, pushed inside 0 … width. No text, no box."""
    if not text:
        return
    (length, height), _ = cv2.getTextSize(text, _FONT, _SIZE, 1)
    x = min(max(at[0] - length // 2, 8), width - length - 8)
    y = at[1] + height // 2
    cv2.rectangle(picture, (x - 5, y - height - 5), (x + length + 5, y + 6), BACKGROUND, -1)
    write(picture, text, (x, y))

"""Black photographs of which only what they say counts."""

from __future__ import annotations

from typing import Any

import numpy as np

from pipeline.images.frames import Frame


def frame_of(size: tuple[int, int] = (3, 2), **more: Any) -> Frame:
    """size: width and height."""
    said = {"make": "NIKON", "model": "D5100", "encoding": "raw", **more}
    width, height = size
    black, mask = np.zeros((height, width, 3), np.float32), np.zeros((height, width), bool)
    return Frame(black, mask, sha256="", **said)

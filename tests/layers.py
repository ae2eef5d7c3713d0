"""Reads pictures back from the EXR files of results."""

from __future__ import annotations

import io

import numpy as np
import OpenEXR

from pipeline.arrays import Floats32
from pipeline.decode.quiet import muted
from pipeline.result_names import lamp_name

Planes = dict[str, Floats32]


def planes_of(data: bytes) -> Planes:
    """Channels (H, W) of an EXR by name, of the type that they are written in."""
    with muted():
        channels = OpenEXR.File(io.BytesIO(data), separate_channels=True).channels()
    return {name: channel.pixels for name, channel in channels.items()}


def picture(planes: Planes, prefix: str = "") -> Floats32:
    """(H, W, 3) of the channels prefix + R, G, B."""
    return np.stack([planes[f"{prefix}{letter}"] for letter in "RGB"], axis=-1)


def layers_of(planes: Planes, count: int) -> Floats32:
    """Layers (N, H, W, 3) of so many lamps."""
    return np.stack([picture(planes, f"{lamp_name(lamp)}.") for lamp in range(count)])

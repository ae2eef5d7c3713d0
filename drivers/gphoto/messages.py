"""What goes between a driver and the process of libgphoto2: pickles, each after its length."""

from __future__ import annotations

import pickle
import struct
from typing import Any

LENGTH = struct.Struct("<I")
"""The length in bytes, before every message."""

ROOT = "/"
"""The folder that all others are in."""


def packed(message: Any) -> bytes:
    """Give a message as it is sent."""
    raw = pickle.dumps(message)
    return LENGTH.pack(len(raw)) + raw

"""From the bytes of a photograph to linear light."""

from __future__ import annotations

from pipeline.decode.header import Header, read_alike
from pipeline.decode.reader import decode, read_header

__all__ = ["Header", "decode", "read_alike", "read_header"]

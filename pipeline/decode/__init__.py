"""From the bytes of a photograph to linear light."""

from __future__ import annotations

from pipeline.decode.reader import check_header, decode

__all__ = ["check_header", "decode"]

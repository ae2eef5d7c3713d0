"""Headers of sound JPEGs that are odd in a way that says nothing of the picture."""

from __future__ import annotations

_APP0, _APP14, _START_OF_SCAN = 0xE0, 0xEE, 0xDA
_SEQUENTIAL = (0xC0, 0xC1)
_JFIF, _JFIF_VERSION = b"JFIF\0", 5
_ADOBE, _ADOBE_TRANSFORM = b"Adobe", 11
_RGB, _YCBCR = 0, 1
_WHOLE_BLOCKS = b"\0\x3f\0"
"""Ss, Se and Ah/Al, the end of a scan's header where it is not progressive; ITU-T T.81, B.2.3."""


def plain_header(data: bytes) -> bytes:
    """Return a JPEG with what libjpeg only warns of in its header put right.

    Samsung's phones write 0 for the last coefficient of a sequential scan, others a JFIF version or
    an Adobe transform that libjpeg does not know. It decodes them as they are meant, but a decoder
    that is to stop at damage stops at any warning. Bytes that are no JPEG come back as they are.
    """
    plain = bytearray(data)
    sequential = False
    position = 2
    while plain[position : position + 1] == b"\xff":
        start = position + 4
        end = position + 2 + int.from_bytes(plain[position + 2 : start], "big")
        if not start < end <= len(plain):  # cut off, or fill bytes, for the decoder to judge
            break
        kind, length = plain[position + 1], end - start
        if kind in _SEQUENTIAL:
            sequential = True
        elif kind == _APP0 and data.startswith(_JFIF, start) and length > _JFIF_VERSION:
            plain[start + _JFIF_VERSION] = 1
        elif kind == _APP14 and data.startswith(_ADOBE, start) and length > _ADOBE_TRANSFORM:
            if plain[start + _ADOBE_TRANSFORM] != _RGB:
                plain[start + _ADOBE_TRANSFORM] = _YCBCR
        elif kind == _START_OF_SCAN:
            if sequential and length > len(_WHOLE_BLOCKS):
                plain[end - len(_WHOLE_BLOCKS) : end] = _WHOLE_BLOCKS
            break
        position = end
    return bytes(plain)

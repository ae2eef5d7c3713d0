"""DNGs whose values LibRaw would take for others than are meant: refused, with what to do."""

from __future__ import annotations

import struct
from collections.abc import Iterator

from tifffile import TiffPage

from pipeline.decode.samples import UnsuitableError
from pipeline.decode.tiff import FLOATS, LINEAR_RAW, LOSSY_JPEG, WHITE_LEVEL, raw_pages

LINEARIZATION = 50712
_OPCODE_LISTS = (51008, 51009, 51022)
_MAP_POLYNOMIAL = 8
_BENDING = (7, _MAP_POLYNOMIAL, 10, 11)
"""Opcodes of the DNG specification 1.4 that change how values follow light: MapTable,
MapPolynomial, DeltaPerRow and DeltaPerColumn. All others move or scale, both of a pair alike.
"""
_DEFLATED = 8
_PREDICTED = (3, 34894, 34895)
_FLOAT_BITS = 32


def refuse_misread(data: bytes) -> None:
    """Raise UnsuitableError for a DNG of which LibRaw would make wrong values, and say nothing.

    Not for any other file, nor for one that only LibRaw understands.
    """
    try:
        with raw_pages(data) as pages:
            misread = any(map(_deflated_plainly, pages))
            unscaled = any(map(_without_white, pages))
            bent = any(map(_bent, pages))
    except Exception:  # not a TIFF, or a damaged one, for LibRaw to judge
        return
    if misread:
        raise UnsuitableError(
            "is a DNG of a compression that is not read: save it as an uncompressed or lossless "
            "DNG, or as a TIFF."
        )
    if unscaled:
        raise UnsuitableError(
            "is a DNG of half floats that does not tell their white level: save it as a TIFF or an "
            "OpenEXR of floats."
        )
    if bent:
        raise UnsuitableError(
            "is a DNG whose values are bent in a way that is not read: save it as a lossless DNG, "
            "or as a TIFF."
        )


def _deflated_plainly(page: TiffPage) -> bool:
    """Whether LibRaw undoes a predictor that is not there; of integers it does not even open."""
    floats = page.sampleformat == FLOATS
    return page.compression == _DEFLATED and not (floats and page.predictor in _PREDICTED)


def _without_white(page: TiffPage) -> bool:
    """Whether LibRaw takes the largest integer of as many bits for the white of floats."""
    short = page.sampleformat == FLOATS and page.bitspersample < _FLOAT_BITS
    return short and WHITE_LEVEL not in page.tags


def _bent(page: TiffPage) -> bool:
    """Whether values follow light by what LibRaw does not look at.

    In lossy DNGs it does look at one polynomial for each colour, and at nothing else.
    """
    if page.compression != LOSSY_JPEG or page.photometric != LINEAR_RAW:
        return bool(_bending(page))
    return polynomials(page) is None


def polynomials(page: TiffPage) -> list[bytes] | None:
    """Parameters of the polynomials of a full picture's colours, the first's first.

    None where there is not one for each of three, or where anything else bends values.
    """
    bending = _bending(page)
    if LINEARIZATION in page.tags or any(opcode != _MAP_POLYNOMIAL for opcode, _ in bending):
        return None
    found = sorted((parameters for _, parameters in bending), key=_planes)
    return found if [*map(_planes, found)] == [(0, 1), (1, 1), (2, 1)] else None


def _planes(parameters: bytes) -> tuple[int, int]:
    """First plane that an opcode is for, and how many there are."""
    first, count = struct.unpack_from(">2I", parameters, 16)
    return first, count


def _bending(page: TiffPage) -> list[tuple[int, bytes]]:
    """Opcodes of a picture that bend its values, with their parameters."""
    return [
        (opcode, parameters)
        for tag in _OPCODE_LISTS
        for opcode, parameters in _opcodes(page.tags.valueof(tag, b""))
        if opcode in _BENDING
    ]


def _opcodes(block: bytes) -> Iterator[tuple[int, bytes]]:
    """Walk number and parameters of a list of opcodes, big-endian in any file."""
    at = 4
    for _ in range(int.from_bytes(block[:at], "big")):
        if at + 16 > len(block):
            return
        opcode, _version, _flags, size = struct.unpack_from(">4I", block, at)
        yield opcode, block[at + 16 : at + 16 + size]
        at += 16 + size

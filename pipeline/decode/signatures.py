"""What kind of file some bytes are: by their signature, never by a name or a MIME type."""

from __future__ import annotations

from typing import Literal

Kind = Literal["JPEG", "PNG", "TIFF", "EXR", "HEIF", "RAW"]

_HEIC_BRANDS = {b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx"}
_AVIF_BRANDS = {b"avif", b"avis"}
_ANY_BRANDS = {b"mif1", b"msf1"}
"""Brands of ISO/IEC 23008-12 that leave the compression open."""
_PREFIXES: tuple[tuple[bytes, Kind], ...] = (
    (b"\xff\xd8\xff", "JPEG"),
    (b"\x89PNG\r\n\x1a\n", "PNG"),
    (b"\x76\x2f\x31\x01", "EXR"),
    (b"II*\x00", "TIFF"),
    (b"MM\x00*", "TIFF"),
    (b"II+\x00", "TIFF"),
    (b"MM\x00+", "TIFF"),
    (b"FUJIFILMCCD-RAW", "RAW"),
    (b"IIRO", "RAW"),
    (b"IIRS", "RAW"),
    (b"MMOR", "RAW"),
    (b"IIU\x00", "RAW"),
    (b"FOVb", "RAW"),
    (b"\x00MRM", "RAW"),
    (b"II\x1a\x00\x00\x00HEAPCCDR", "RAW"),
)


def kind_of(data: bytes) -> Kind | None:
    """Kind of the file that starts with these bytes, None when no signature fits.

    "TIFF" stands for everything with a TIFF header, many RAW formats and DNG among them; what
    such a file holds is for the TIFF directories to tell (see tiff.holds_raw).
    """
    for prefix, kind in _PREFIXES:
        if data.startswith(prefix):
            if kind == "TIFF" and data[8:10] == b"CR":  # Canon CR2
                return "RAW"
            return kind
    if data[4:8] == b"ftyp":
        if data[8:12] == b"crx ":  # Canon CR3
            return "RAW"
        if data[8:12] in _HEIC_BRANDS or (data[8:12] in _ANY_BRANDS and not _is_avif(data)):
            return "HEIF"
    return None


def _is_avif(data: bytes) -> bool:
    """Whether a file names AVIF among the brands that it is compatible with, and no HEIC."""
    end = int.from_bytes(data[:4], "big")
    brands = {data[at : at + 4] for at in range(16, min(end, len(data)), 4)}
    return bool(brands & _AVIF_BRANDS) and not brands & _HEIC_BRANDS

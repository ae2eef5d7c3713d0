"""Headers of sound JPEGs: odd in a way that says nothing of the picture, or of no use here."""

from __future__ import annotations

from collections.abc import Iterator

from pipeline.decode.samples import UnsuitableError

_APP0, _APP1, _APP14, _START_OF_SCAN = 0xE0, 0xE1, 0xEE, 0xDA
EXTENDED = 0xC1
_SEQUENTIAL = (0xC0, EXTENDED)
_FRAMES = (*_SEQUENTIAL, 0xC2, 0xC9, 0xCA)
"""Sequential and progressive, in Huffman and arithmetic coding."""
WITHOUT_LOSS = 0xC3
_OTHER_FRAMES = (WITHOUT_LOSS, 0xC5, 0xC6, 0xC7, 0xCB, 0xCD, 0xCE, 0xCF, 0xF7)
"""Without loss, hierarchical, and JPEG-LS."""
_BITS = 8
_COMPONENTS = 5
"""Where a frame's header counts the components; a scan's does so first. ITU-T T.81, B.2.2."""
_JFIF, _JFIF_VERSION = b"JFIF\0", 5
_ADOBE, _ADOBE_TRANSFORM = b"Adobe", 11
_RGB, _YCBCR = 0, 1
_EXIF = b"Exif\0\0"
_FILL = 0xFF
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
    for kind, start, end in _segments(data):
        length = end - start
        if kind in _SEQUENTIAL:
            sequential = True
        elif kind == _APP0 and data.startswith(_JFIF, start) and length > _JFIF_VERSION:
            plain[start + _JFIF_VERSION] = 1
        elif kind == _APP14 and data.startswith(_ADOBE, start) and length > _ADOBE_TRANSFORM:
            if plain[start + _ADOBE_TRANSFORM] != _RGB:
                plain[start + _ADOBE_TRANSFORM] = _YCBCR
        elif kind == _START_OF_SCAN and sequential and length > len(_WHOLE_BLOCKS):
            plain[end - len(_WHOLE_BLOCKS) : end] = _WHOLE_BLOCKS
    return bytes(plain)


def exif_block(data: bytes) -> bytes:
    """EXIF block of a JPEG, which starts with a TIFF header, wherever it is among what comes first.

    Editors and phones put XMP, MPF or profiles before it. Empty where there is none.
    """
    for kind, start, end in _segments(data):
        if kind == _APP1 and data.startswith(_EXIF, start):
            return data[start + len(_EXIF) : end]
    return b""


def tells_its_end(data: bytes) -> bool:
    """Whether a decoder notices by the data alone that some of a JPEG's picture is missing.

    So it does of a sequential one in Huffman coding with all components in its first scan. Of
    others whole scans may be missing, or arithmetic coding goes on with zeros.
    """
    components = None
    for kind, start, _ in _segments(data):
        if kind in _SEQUENTIAL:
            components = data[start + _COMPONENTS]
        elif kind == _START_OF_SCAN:
            return components == data[start]
    return False


def is_whole_header(data: bytes) -> bool:
    """Whether a JPEG's header is whole: its size, how its colours are sampled, and its scan's."""
    kinds = [kind for kind, _, _ in _segments(data)]
    return _START_OF_SCAN in kinds and any(kind in _FRAMES for kind in kinds)


def frame(data: bytes) -> tuple[int, int] | None:
    """Process of a JPEG by its marker, and the number of its components; None of other bytes."""
    for kind, start, _ in _segments(data):
        if kind in _FRAMES or kind in _OTHER_FRAMES:
            return kind, data[start + _COMPONENTS]
    return None


def frame_pixels(data: bytes) -> int:
    """Pixels of a JPEG by its frame, whatever the file around it says; 0 of other bytes."""
    for kind, start, _ in _segments(data):
        if kind in _FRAMES or kind in _OTHER_FRAMES:
            sides = data[start + 1 : start + 3], data[start + 3 : start + 5]
            height, width = (int.from_bytes(side, "big") for side in sides)
            return height * width
    return 0


def refuse_other_processes(data: bytes) -> None:
    """Raise UnsuitableError for a JPEG of more than 8 bits, or one without loss."""
    for kind, start, _ in _segments(data):
        if kind in _OTHER_FRAMES or (kind in _FRAMES and data[start] != _BITS):
            raise UnsuitableError(
                "is a JPEG of more than 8 bits, or one without loss, which are not read: save it "
                "as a usual JPEG, or as a TIFF of 16 bits."
            )


def _segments(data: bytes) -> Iterator[tuple[int, int, int]]:
    """Walk the header to the first scan: the marker's kind, where its data start, and end."""
    position, kind = 2, None
    while kind != _START_OF_SCAN and data[position : position + 1] == b"\xff":
        if data[position + 1 : position + 2] == bytes([_FILL]):  # ITU-T T.81, B.1.1.2
            position += 1
            continue
        start = position + 4
        end = position + 2 + int.from_bytes(data[position + 2 : start], "big")
        if not start <= end <= len(data):  # cut off, for the decoder to judge
            break
        kind = data[position + 1]
        if start < end:  # comments may be empty
            yield kind, start, end
        position = end

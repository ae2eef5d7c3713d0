"""Whether a HEIF file holds all that its picture is coded in.

libheif shows what is missing or damaged in green, and tells nobody. Sources: ISO/IEC 14496-12 for
boxes, 23008-12 for items, of which phones make a picture in tiles, 23008-2 (7.4.2) for what coded
data never hold.
"""

from __future__ import annotations

from collections.abc import Iterator

from pipeline.decode.boxes import box, boxes

_KNOWN_BOXES = (b"ftyp", b"meta", b"mdat", b"free")
_LENGTH, _UNIT_HEAD = 4, 2  # bytes before each unit of coded data, and of its own header
_HOLE = bytes(16)  # no unit has three bytes of 0 in a row, but for a few that some coders append
_IN_FILE, _IN_META = 0, 1  # where an item's bytes are
_DERIVED = (b"grid", b"iovl", b"iden")  # tiles, pictures on one another, one turned or cropped


def is_complete(data: bytes) -> bool:
    """Whether all that the primary picture is coded in is there, and looks like coded data.

    What this does not understand is left to libheif. A byte that is another is not noticed.
    """
    if not _boxes_complete(data):
        return False
    try:
        return all(_is_coded(item) for item in _primary_items(data))
    except EOFError:  # the boxes are damaged, which libheif tells
        return True


def _boxes_complete(data: bytes) -> bool:
    """Whether the boxes at the top of the file end within it."""
    position = 0
    while position < len(data):
        size, kind = int.from_bytes(data[position : position + 4], "big"), data[position + 4 :][:4]
        if kind not in _KNOWN_BOXES or size == 0:  # phones append what they like; 0 is to the end
            return True
        if size == 1:  # the size follows the type, in 8 bytes
            size = int.from_bytes(data[position + 8 : position + 16], "big")
        if size < 8 or position + size > len(data):
            return False
        position += size
    return True


def _is_coded(item: bytes) -> bool:
    """Whether units of HEVC, each after its length, fill an item, and none has a hole."""
    at = 0
    while at < len(item):
        start = at + _LENGTH
        at = start + int.from_bytes(item[at:start], "big")
        if not start + _UNIT_HEAD <= at <= len(item) or _HOLE in item[start:at]:
            return False
    return at > 0


def _primary_items(data: bytes) -> Iterator[bytes]:
    """The bytes of every item of HEVC that the primary picture is made of, none of what is missing.

    Raises EOFError.
    """
    meta = box(data, b"meta")[4:]
    kinds, made_of = _kinds(box(meta, b"iinf")), _made_of(box(meta, b"iref"))
    places = _places(box(meta, b"iloc"))
    primary = _Fields(box(meta, b"pitm"))
    waiting, seen = [primary.take(4 if primary.version else 2)], set[int]()
    while waiting:
        item = waiting.pop()
        if item in seen:
            continue
        seen.add(item)
        kind, parts = kinds.get(item), made_of.get(item, [])
        waiting += parts
        if kind is None or (kind in _DERIVED and not parts):
            yield b""
        method, extents = places.get(item, (_IN_FILE, []))
        if kind == b"hvc1" and method in {_IN_FILE, _IN_META}:
            source = data if method == _IN_FILE else box(meta, b"idat")
            yield b"".join(source[start:end] for start, end in extents)


class _Fields:
    """Numbers of a box that begins with its version and flags, one after another."""

    def __init__(self, content: bytes) -> None:
        self._content, self._at = content, 0
        self.version = self.take(1)
        self.take(3)

    def take(self, size: int) -> int:
        """The next number, of so many bytes. Raises EOFError."""
        self._at += size
        if self._at > len(self._content):
            raise EOFError
        return int.from_bytes(self._content[self._at - size : self._at], "big")

    def rest(self) -> bytes:
        """What follows the numbers taken."""
        return self._content[self._at :]


def _kinds(infos: bytes) -> dict[int, bytes]:
    """Kinds of items by their numbers; infos: an `iinf`."""
    fields = _Fields(infos)
    fields.take(4 if fields.version else 2)
    kinds = {}
    for _, content in boxes(fields.rest()):
        info = _Fields(content)
        number = info.take(2 if info.version < 3 else 4)
        info.take(2)
        kinds[number] = info.rest()[:4]
    return kinds


def _made_of(references: bytes) -> dict[int, list[int]]:
    """Numbers of the items that one is derived from, by its own; references: an `iref` or none."""
    made_of: dict[int, list[int]] = {}
    if not references:
        return made_of
    size = 4 if _Fields(references).version else 2
    for kind, content in boxes(references[4:]):
        if kind == b"dimg":
            items = [content[at : at + size] for at in range(size + 2, len(content), size)]
            made_of[int.from_bytes(content[:size], "big")] = [
                int.from_bytes(item, "big") for item in items
            ]
    return made_of


def _places(locations: bytes) -> dict[int, tuple[int, list[tuple[int, int]]]]:
    """How items are placed, and starts and ends of their parts; locations: an `iloc`."""
    fields = _Fields(locations)
    sizes = fields.take(1), fields.take(1)
    offset, length, base = sizes[0] >> 4, sizes[0] & 15, sizes[1] >> 4
    with_method = fields.version in {1, 2}
    index, numbers = sizes[1] & 15 if with_method else 0, 2 if fields.version < 2 else 4
    places = {}
    for _ in range(fields.take(numbers)):
        item = fields.take(numbers)
        method = fields.take(2) & 15 if with_method else _IN_FILE
        fields.take(2)
        first, extents = fields.take(base), []
        for _ in range(fields.take(2)):
            fields.take(index)
            start = first + fields.take(offset)
            extents.append((start, start + fields.take(length)))
        places[item] = method, extents
    return places

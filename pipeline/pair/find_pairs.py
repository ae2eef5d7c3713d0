"""Finds the pairs among photographs of a session: which was taken without the flash, which with."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from pipeline.decode import Header, read_alike, read_header
from pipeline.decode.metadata import Metadata, read_metadata

_LONGEST_GAP_S = 120.0
"""Between the two photographs of a pair; a person may have to switch the flash by hand."""

_BURST_S = 10.0
"""Within it photographs of several pairs may come in any order."""


@dataclass(frozen=True)
class Shot:
    """What a photograph says of itself."""

    metadata: Metadata
    header: Header

    @property
    def lack(self) -> str | None:
        """What is missing to find its pair, None when nothing is."""
        if self.metadata.flash_fired is None:
            return "its EXIF does not say whether the flash fired"
        if self.metadata.taken_s is None:
            return "its EXIF does not say when it was taken"
        return None


@dataclass(frozen=True)
class Pairs:
    """found: names (no flash, flash) in the order of time. left: why others are in no pair."""

    found: list[tuple[str, str]]
    left: dict[str, str]


def read_shot(data: bytes) -> Shot:
    """Read what a file says of itself. Raises UnreadableImageError, ImageTooLargeError."""
    return Shot(read_metadata(data), read_header(data))


def find_pairs(shots: Mapping[str, Shot]) -> Pairs:
    """Pair photographs of one camera, kind and size, one with the flash and one without.

    The nearest in time belong together, at most two minutes apart; each is in one pair. What is
    left over of two bursts is none: between its photographs the camera took a pair.
    """
    usable = {name: shot for name, shot in shots.items() if shot.lack is None}
    pairs: list[tuple[str, str]] = []
    taken: set[str] = set()
    for _, no_flash, flash in sorted(_candidates(usable)):
        if taken.isdisjoint((no_flash, flash)) and not _encloses(no_flash, flash, pairs, usable):
            pairs.append((no_flash, flash))
            taken |= {no_flash, flash}
    alone = "no photograph with the other state of the flash belongs to it"
    left = {name: shot.lack or alone for name, shot in shots.items() if name not in taken}
    return Pairs(sorted(pairs, key=lambda pair: _time(usable[pair[0]])), left)


def _candidates(shots: Mapping[str, Shot]) -> Iterable[tuple[float, str, str]]:
    in_time = sorted(shots.items(), key=lambda item: _time(item[1]))
    for number, (first, one) in enumerate(in_time):
        for second, other in in_time[number + 1 :]:
            gap = _time(other) - _time(one)
            if gap > _LONGEST_GAP_S:
                break
            if _alike(one, other) and _fired(one) != _fired(other):
                yield (gap, second, first) if _fired(one) else (gap, first, second)


def _encloses(
    no_flash: str, flash: str, pairs: Iterable[tuple[str, str]], shots: Mapping[str, Shot]
) -> bool:
    """Whether the camera took one of these pairs between two photographs further apart."""
    begin, end = sorted(_time(shots[name]) for name in (no_flash, flash))
    if end - begin <= _BURST_S:
        return False
    return any(
        all(begin <= _time(shots[name]) <= end for name in pair)
        and _camera(shots[pair[0]]) == _camera(shots[no_flash])
        for pair in pairs
    )


def _alike(one: Shot, other: Shot) -> bool:
    """Whether two are of one camera, kind and size, whichever was taken with the flash."""
    same_size = one.header.size == read_alike(one.header, other.header).size
    same_kind = one.header.kind == other.header.kind
    return _camera(one) == _camera(other) and same_kind and same_size


def _camera(shot: Shot) -> tuple[str, str, str]:
    return shot.metadata.make, shot.metadata.model, shot.metadata.serial


def _fired(shot: Shot) -> bool:
    return shot.metadata.flash_fired is True


def _time(shot: Shot) -> float:
    assert shot.metadata.taken_s is not None
    return shot.metadata.taken_s

from __future__ import annotations

from typing import Any

import pytest

from pipeline.decode import Header
from pipeline.decode.metadata import Metadata
from pipeline.decode.signatures import Kind
from pipeline.pair import find_pairs as module
from pipeline.pair.find_pairs import Shot, find_pairs, read_shot
from tests.raw_files import cr3

ALONE = "no photograph with the other state of the flash belongs to it"


def _shot(
    taken_s: float | None,
    fired: bool | None,
    size: tuple[int, int] = (60, 40),
    orientation: int = 1,
    kind: Kind = "JPEG",
    **facts: Any,
) -> Shot:
    facts = {"make": "Nikon", "model": "D5100", **facts}
    return Shot(
        Metadata(taken_s=taken_s, flash_fired=fired, **facts), Header(kind, size, orientation)
    )


def test_a_pair_is_one_with_and_one_without_whichever_came_first() -> None:
    shots = {"a": _shot(10, True), "b": _shot(12, False), "c": _shot(500, False)}
    shots["d"] = _shot(503, True)
    found = find_pairs(shots)
    assert (found.found, found.left) == ([("b", "a"), ("c", "d")], {})


def test_raw_files_of_canon_are_paired(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        module, "read_header", lambda _data: Header("RAW", (60, 40))
    )  # they have no pixels
    shots = {
        name: read_shot(cr3({0x9209: flash, 0x9003: f"2024:02:29 23:59:{second}"}, {271: "Canon"}))
        for name, flash, second in (("a.cr3", 0x10, 10), ("b.cr3", 0x09, 13))
    }
    found = find_pairs(shots)
    assert (found.found, found.left) == ([("a.cr3", "b.cr3")], {})


def test_the_nearest_in_time_belong_together() -> None:
    shots = {"x": _shot(0, False), "y": _shot(30, False), "z": _shot(31, True)}
    found = find_pairs(shots)
    assert (found.found, found.left) == ([("y", "z")], {"x": ALONE})


def test_pairs_are_listed_in_time() -> None:
    shots = {"e": _shot(900, False), "f": _shot(901, True), "g": _shot(5, True)}
    shots["h"] = _shot(9, False)
    assert find_pairs(shots).found == [("h", "g"), ("e", "f")]


@pytest.mark.parametrize(
    ("other", "belongs"),
    [
        (_shot(120, True), True),
        (_shot(120.5, True), False),
        (_shot(1, False), False),
        (_shot(1, True, (40, 60)), False),
        (_shot(1, True, (40, 60), 6), True),
        (_shot(1, True, (60, 40), 3), True),
        (_shot(1, True, (50, 60), 6), False),
        (_shot(1, True, model="D3500"), False),
        (_shot(1, True, make="Canon"), False),
        (_shot(1, True, serial="2"), False),
        (_shot(1, True, kind="RAW"), False),
    ],
)
def test_what_belongs_together(other: Shot, belongs: bool) -> None:
    found = find_pairs({"a": _shot(0, False), "b": other})
    assert found.found == ([("a", "b")] if belongs else [])
    assert found.left == ({} if belongs else {"a": ALONE, "b": ALONE})


def test_two_bodies_of_one_model_are_two_cameras() -> None:
    shots = {
        "a1": _shot(30, False, serial="1"),
        "b1": _shot(31, True, serial="2"),
        "a2": _shot(34, True, serial="1"),
    }
    found = find_pairs(shots)
    assert (found.found, found.left) == ([("a1", "a2")], {"b1": ALONE})


def test_what_says_too_little_is_left() -> None:
    shots = {"a": _shot(None, True), "b": _shot(0, None), "c": _shot(1, False)}
    assert find_pairs(shots).left == {
        "a": "its EXIF does not say when it was taken",
        "b": "its EXIF does not say whether the flash fired",
        "c": ALONE,
    }


def test_a_long_session_of_pairs_of_three_seconds() -> None:
    shots = {}
    for number in range(200):
        shots[f"{number}n"] = _shot(10 * number, False)
        shots[f"{number}f"] = _shot(10 * number + 3, True)
    assert find_pairs(shots).found == [(f"{n}n", f"{n}f") for n in range(200)]


def test_what_two_bursts_leave_over_is_no_pair() -> None:
    """One without and two with the flash, then one with and two without of something else."""
    shots = {"a1": _shot(10.1, False), "a2": _shot(10.5, True), "a3": _shot(10.9, True)}
    shots |= {"b1": _shot(100, True), "b2": _shot(100, False), "b3": _shot(100, False)}

    found = find_pairs(shots)

    assert found.found == [("a1", "a2"), ("b2", "b1")]
    assert found.left == {"a3": ALONE, "b3": ALONE}


def test_pairs_of_a_burst_may_lie_within_each_other() -> None:
    shots = {"a": _shot(10, False), "b": _shot(11, False), "c": _shot(12, True)}
    shots["d"] = _shot(20, True)

    assert find_pairs(shots).found == [("a", "d"), ("b", "c")]


def test_a_pair_of_another_camera_may_lie_between() -> None:
    shots = {"a": _shot(10, False), "b": _shot(60, True)}
    shots |= {"c": _shot(30, False, model="D850"), "d": _shot(31, True, model="D850")}

    assert find_pairs(shots).found == [("a", "b"), ("c", "d")]

from __future__ import annotations

import threading
from collections.abc import Iterator

import cv2
import pytest

from pipeline.threads import ahead, at_once

_PATIENCE = 60.0  # seconds, for what takes none


@pytest.fixture(params=[1, 2, 8])
def _threads(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cv2, "getNumThreads", lambda: request.param)


@pytest.fixture
def _several(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cv2, "getNumThreads", lambda: 2)


@pytest.mark.usefixtures("_threads")
@pytest.mark.parametrize("items", [[], [None], [3, 1, 2], list(range(100))])
def test_items_keep_their_order(items: list[int | None]) -> None:
    assert list(ahead(iter(items))) == items


@pytest.mark.usefixtures("_several")
def test_the_next_item_alone_is_made_while_one_is_used() -> None:
    made = [threading.Event() for _ in range(4)]

    def items() -> Iterator[int]:
        for number, event in enumerate(made):
            event.set()
            yield number

    for number in ahead(items()):
        assert all(event.wait(_PATIENCE) for event in made[: number + 2])
        assert not any(event.is_set() for event in made[number + 2 :])


def test_one_processor_makes_items_where_they_are_used(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cv2, "getNumThreads", lambda: 1)
    makers = ahead(threading.get_ident() for _ in range(3))
    assert set(makers) == {threading.get_ident()}


@pytest.mark.usefixtures("_several")
def test_several_make_them_in_one_other_thread() -> None:
    makers = set(ahead(threading.get_ident() for _ in range(3)))
    assert len(makers) == 1
    assert threading.get_ident() not in makers


@pytest.fixture
def _no_room(monkeypatch: pytest.MonkeyPatch) -> None:
    def no_room(_: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(threading.Thread, "start", no_room)


@pytest.mark.usefixtures("_several", "_no_room")
def test_without_threads_items_are_made_where_they_are_used() -> None:
    assert list(ahead(iter(range(5)))) == [0, 1, 2, 3, 4]


@pytest.mark.usefixtures("_threads")
def test_what_fails_is_told_after_what_was_made_before() -> None:
    def items() -> Iterator[int]:
        yield 1
        yield 2
        raise MemoryError("no more")

    given = []
    with pytest.raises(MemoryError, match="no more"):
        for number in ahead(items()):
            given.append(number)
    assert given == [1, 2]


@pytest.mark.usefixtures("_several")
def test_no_thread_is_left_where_not_all_is_used() -> None:
    threads = threading.active_count()
    unfinished = ahead(iter(range(10)))
    assert next(unfinished) == 0
    assert threading.active_count() == threads + 1
    unfinished.close()
    assert threading.active_count() == threads


@pytest.mark.usefixtures("_threads")
@pytest.mark.parametrize("items", [[3], [3, 1], [3, 1, 2]])
def test_results_keep_the_order_of_the_items(items: list[int]) -> None:
    assert at_once(lambda item: 10 * item, items) == [10 * item for item in items]


@pytest.mark.usefixtures("_several")
def test_items_are_worked_on_at_once() -> None:
    """Each waits for the other: one after the other they would not come to an end."""
    both = threading.Barrier(2, timeout=_PATIENCE)
    assert set(at_once(lambda _: both.wait(), [0, 1])) == {0, 1}


def test_one_processor_works_on_one_after_the_other(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cv2, "getNumThreads", lambda: 1)
    assert set(at_once(lambda _: threading.get_ident(), [0, 1])) == {threading.get_ident()}


@pytest.mark.usefixtures("_several", "_no_room")
def test_without_threads_items_are_worked_on_one_after_the_other() -> None:
    assert at_once(lambda item: 10 * item, [3, 1]) == [30, 10]


@pytest.mark.usefixtures("_threads")
@pytest.mark.parametrize("bad", [0, 1])
def test_what_fails_is_raised(bad: int) -> None:
    def work(item: int) -> int:
        if item == bad:
            raise MemoryError("no more")
        return item

    with pytest.raises(MemoryError, match="no more"):
        at_once(work, [0, 1])

"""Work on several things at once, in a process that has more than one processor.

OpenCV knows how many it is to use; whoever runs several jobs at once tells it.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import islice
from typing import TypeVar

import cv2

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")


def ahead(items: Iterator[_Item]) -> Generator[_Item, None, None]:
    """Give items in their order, each made in a thread of its own while the last one is used.

    One is made ahead, so that memory holds one more. With one processor, or where no thread may be
    started, they are made in the thread that uses them. What making an item raises is raised where
    the item would have been given.
    """
    if _is_alone():
        yield from items
        return
    with ThreadPoolExecutor(1) as maker:
        try:
            coming = maker.submit(list, islice(items, 1))
        except RuntimeError:  # memory or the number of threads is limited
            yield from items
            return
        while item := coming.result():
            coming = maker.submit(list, islice(items, 1))
            yield item[0]


def at_once(work: Callable[[_Item], _Result], items: Sequence[_Item]) -> list[_Result]:
    """Results of the same work on few items, the first in this thread and each other in its own.

    With one processor, or where no thread may be started, one after the other. What work on the
    first of them that fails raises is raised.
    """
    if _is_alone():
        return [work(item) for item in items]
    with ThreadPoolExecutor(len(items)) as workers:
        try:
            coming = [workers.submit(work, item) for item in items[1:]]
        except RuntimeError:
            return [work(item) for item in items]
        return [work(items[0]), *(one.result() for one in coming)]


def _is_alone() -> bool:
    return bool(cv2.getNumThreads() < 2)

"""Work on the next item while the one before is used."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import islice
from typing import TypeVar

import cv2

_Item = TypeVar("_Item")


def ahead(items: Iterator[_Item]) -> Generator[_Item, None, None]:
    """Give items in their order, each made in a thread of its own while the last one is used.

    One is made ahead, so that memory holds one more. A process that is to use one processor, as
    OpenCV is told, or that may start no thread makes them in the thread that uses them. What making
    an item raises is raised where the item would have been given.
    """
    if cv2.getNumThreads() < 2:
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

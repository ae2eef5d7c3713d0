"""The data window of an OpenEXR, for readers of files with OpenEXR and without."""

from __future__ import annotations

from collections.abc import Sequence


def size_of_window(first: Sequence[int], last: Sequence[int]) -> tuple[int, int]:
    """(width, height) of a data window; first, last: (x, y) of its outermost pixels."""
    return int(last[0]) - int(first[0]) + 1, int(last[1]) - int(first[1]) + 1

"""Rows of a picture that are worked on at a time."""

from __future__ import annotations

from collections.abc import Iterator

STRIP_ROWS = 32
"""Rows worked on at a time, so that peak memory is the images and one strip."""


def strips(height: int, rows: int) -> Iterator[slice]:
    """Slices of so many rows that cover 0…height; the last may have fewer."""
    for top in range(0, height, rows):
        yield slice(top, min(top + rows, height))


def widened(rows: slice, halo: int, height: int) -> tuple[slice, slice]:
    """Rows with a halo as far as the picture goes, and where the rows lie among them."""
    top, bottom = max(rows.start - halo, 0), min(rows.stop + halo, height)
    return slice(top, bottom), slice(rows.start - top, rows.stop - top)

"""Rows of a picture that are worked on at a time."""

from __future__ import annotations


def widened(rows: slice, halo: int, height: int) -> tuple[slice, slice]:
    """Rows with a halo as far as the picture goes, and where the rows lie among them."""
    top, bottom = max(rows.start - halo, 0), min(rows.stop + halo, height)
    return slice(top, bottom), slice(rows.start - top, rows.stop - top)

from __future__ import annotations

import pytest

from pipeline.images.strips import strips, widened


@pytest.mark.parametrize(
    ("rows", "halo", "wide", "inner"),
    [
        (slice(10, 20), 3, slice(7, 23), slice(3, 13)),
        (slice(0, 20), 3, slice(0, 23), slice(0, 20)),  # upper border
        (slice(2, 5), 3, slice(0, 8), slice(2, 5)),  # nearer to it than the halo
        (slice(90, 100), 3, slice(87, 100), slice(3, 13)),  # lower border
        (slice(0, 100), 200, slice(0, 100), slice(0, 100)),
        (slice(10, 20), 0, slice(10, 20), slice(0, 10)),
    ],
)
def test_a_halo_goes_as_far_as_the_picture(
    rows: slice, halo: int, wide: slice, inner: slice
) -> None:
    assert widened(rows, halo, 100) == (wide, inner)
    assert list(range(100))[wide][inner] == list(range(100))[rows]


@pytest.mark.parametrize(
    ("height", "rows", "cut"),
    [(0, 4, []), (3, 4, [(0, 3)]), (8, 4, [(0, 4), (4, 8)]), (9, 4, [(0, 4), (4, 8), (8, 9)])],
)
def test_strips_cover_every_row_once(height: int, rows: int, cut: list[tuple[int, int]]) -> None:
    assert [(strip.start, strip.stop) for strip in strips(height, rows)] == cut

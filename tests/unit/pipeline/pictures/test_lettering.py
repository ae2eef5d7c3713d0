from __future__ import annotations

import numpy as np
import pytest

from pipeline.pictures.lettering import (
    BACKGROUND,
    INK,
    box_of,
    overlap,
    panel,
    write,
    write_boxed,
)


def test_a_panel_is_dark_and_even() -> None:
    picture = panel(20, 30)

    assert picture.shape == (20, 30, 3)
    assert picture.dtype == np.uint8
    assert (picture == BACKGROUND).all()


def test_words_stand_on_their_base_line_from_the_left() -> None:
    picture = panel(60, 300)

    write(picture, "lamps", (40, 30))

    rows, columns = np.nonzero((picture != BACKGROUND).any(axis=2))
    assert 40 <= columns.min() <= 44
    assert 12 <= rows.min() < 24
    assert rows.max() <= 36  # the p
    assert picture.max() <= max(INK)


def test_boxed_words_are_centred_and_legible_on_anything() -> None:
    picture = np.full((80, 300, 3), 255, np.uint8)

    write_boxed(picture, "lamp1", (150, 40), 300)

    box = (picture == BACKGROUND).all(axis=2)
    rows, columns = np.nonzero(box)
    assert (columns.min() + columns.max()) / 2 == pytest.approx(150, abs=3)
    assert (rows.min() + rows.max()) / 2 == pytest.approx(40, abs=4)
    inside = picture[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
    assert (inside > 200).any()


@pytest.mark.parametrize("x", [0, 299])
def test_boxed_words_stay_inside(x: int) -> None:
    picture = np.full((80, 300, 3), 255, np.uint8)

    write_boxed(picture, "a long label", (x, 40), 300)

    columns = np.nonzero((picture == BACKGROUND).all(axis=2))[1]
    assert columns.min() >= 2
    assert columns.max() <= 297


def test_no_words_need_no_box() -> None:
    picture = np.full((80, 300, 3), 255, np.uint8)

    write_boxed(picture, "", (150, 40), 300)

    assert (picture == 255).all()


def test_the_box_is_told_before_it_is_drawn() -> None:
    picture = np.full((80, 300, 3), 255, np.uint8)

    write_boxed(picture, "lamp1", (290, 40), 300)

    rows, columns = np.nonzero((picture == BACKGROUND).all(axis=2))
    box = (columns.min(), rows.min(), columns.max(), rows.max())
    assert box_of("lamp1", (290, 40), 300) == box


@pytest.mark.parametrize(
    ("other", "expected"),
    [
        ((20, 20, 30, 30), True),
        ((21, 10, 30, 20), False),
        ((10, 21, 20, 30), False),
        ((0, 0, 9, 30), False),
        ((0, 0, 30, 9), False),
        ((12, 12, 18, 18), True),
    ],
)
def test_boxes_overlap_where_they_share_a_pixel(
    other: tuple[int, int, int, int], expected: bool
) -> None:
    assert overlap((10, 10, 20, 20), other) == expected
    assert overlap(other, (10, 10, 20, 20)) == expected

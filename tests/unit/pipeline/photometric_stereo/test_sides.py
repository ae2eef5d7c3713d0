from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.arrays import Floats64
from pipeline.photometric_stereo.sides import jumps, sides

SIZE = 24
WHOLE = np.ones((SIZE, SIZE), bool)
across = np.arange(SIZE) * np.ones((SIZE, 1))


def halves(left: int, right: int) -> NDArray[np.intp]:
    """Part 1 to a column, part 2 from a column on, between them 0."""
    return np.where(across < left, 1, np.where(across >= right, 2, 0))


def step(at: int, factor: float) -> Floats64:
    return np.where(across < at, 1.0, factor)


@pytest.mark.parametrize("jump", [9, 10, 11, 12, 13])
def test_a_seam_is_dealt_out_where_flash_and_light_change_at_once(jump: int) -> None:
    flash, relative = step(jump, 0.5), step(jump, 3.0)

    found = sides(flash, flash * relative, WHOLE, halves(9, 13), 0)

    np.testing.assert_array_equal(found, np.where(across < jump, 1, 2))


@pytest.mark.parametrize(("paint", "shadow"), [(10, 12), (12, 10)])
def test_neither_paint_nor_a_shadow_is_taken_for_a_jump(paint: int, shadow: int) -> None:
    """Both are stronger than the jump."""
    flash = step(11, 0.6) * step(paint, 5.0)
    relative = step(11, 0.6) * step(shadow, 5.0)

    found = sides(flash, flash * relative, WHOLE, halves(9, 13), 0)

    np.testing.assert_array_equal(found, np.where(across < 11, 1, 2))


def test_parts_that_reach_beyond_the_jump_give_back_what_is_not_theirs() -> None:
    flash = step(10, 0.5)

    found = sides(flash, flash * step(10, 3.0), WHOLE, halves(12, 13), 3)

    np.testing.assert_array_equal(found, np.where(across < 10, 1, 2))


def test_farther_from_another_part_than_is_said_a_part_stays() -> None:
    flash = step(6, 0.5)

    found = sides(flash, flash * step(6, 3.0), WHOLE, halves(12, 13), 3)

    assert (found[across < 10] == 1).all()
    assert (found[across > 12] == 2).all()


def test_one_part_has_all_of_the_mask() -> None:
    mask = across < 20

    found = sides(np.ones_like(across), np.ones_like(across), mask, np.where(across < 9, 1, 0), 2)

    np.testing.assert_array_equal(found, mask)


def test_an_island_that_no_way_leads_to_belongs_to_the_nearest_part() -> None:
    mask = (across < 14) | (across > 18)
    parts = halves(6, 7) * (across < 14)

    found = sides(np.ones_like(across), np.ones_like(across), mask, parts, 0)

    assert (found[across > 18] == 2).all()
    assert (found[~mask] == 0).all()


def test_dark_pixels_are_dealt_out_too() -> None:
    flash = np.where((across == 10) | (across == 11), 0.0, 1.0)

    found = sides(flash, flash, WHOLE, halves(9, 13), 0)

    assert set(np.unique(found)) == {1, 2}
    assert (np.diff(found, axis=1) >= 0).all()


def test_a_thin_part_is_not_lost() -> None:
    """Three columns, all of them nearer to others than parts may be wrong by."""
    parts = np.where(across < 10, 1, np.where(across < 13, 2, 3))
    flash = np.where((across < 10) | (across > 12), 1.0, 0.5)

    found = sides(flash, flash**3, WHOLE, parts, 4)

    np.testing.assert_array_equal(found, parts)


def test_depth_may_jump_where_flash_and_light_change_at_once() -> None:
    """Both by a tenth; pixels on either side are told, and none beside the mask."""
    mask = WHOLE.copy()
    mask[:2] = False

    found = jumps(step(11, 1.12), step(11, 1.12 * 0.88), mask)

    np.testing.assert_array_equal(found, ((across == 10) | (across == 11)) & mask)
    assert not jumps(step(11, 1.12), step(11, 1.12 * 0.94), mask).any()


def test_paint_and_shadows_are_no_jumps() -> None:
    paint, shadow = step(10, 5.0), step(13, 0.3)

    assert not jumps(paint, paint * shadow, WHOLE).any()

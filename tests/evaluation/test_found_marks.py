from __future__ import annotations

import numpy as np
import pytest

from pipeline.options import Circle
from tests.cluttered import _SUB, SIZE, Plan, _outline, _surface
from tests.evaluation.found_marks import Case, Find, row

CASE: Case = ("a ColorChecker", "chart", "chart", Plan(), 120)


def test_a_row_tells_what_became_of_each_room() -> None:
    found = [Find(CASE[0], 1, off) for off in (0.004, 0.02, 0.099)]
    wrong = [Find(CASE[0], 1, off) for off in (0.1, np.inf)]
    refused = [Find(CASE[0], count, None) for count in (0, 0, 0, 2)]
    assert row(CASE, [*found, *wrong, *refused]) == [
        "a ColorChecker", "9", "3", "3", "1", "2", "2.0 / 9.9"
    ]  # fmt: skip


def test_where_nothing_is_found_nothing_is_off() -> None:
    assert row(CASE, [Find(CASE[0], 0, None)])[1:] == ["1", "0", "1", "0", "0", "–"]


@pytest.mark.parametrize(("x", "y"), [(360.0, 240.0), (600.0, 130.0)])
def test_the_true_outline_of_a_sphere_has_the_area_that_it_fills(x: float, y: float) -> None:
    """In the corner its long semi-axis, by which it is placed, is 2% longer."""
    placed = Circle(x=x, y=y, radius=100.0)
    seen, *_ = _surface(placed, (SIZE[1] * _SUB, SIZE[0] * _SUB))

    true = _outline(placed)

    rows, columns = np.nonzero(seen)
    assert len(rows) / _SUB**2 == pytest.approx(np.pi * true.radius**2, rel=1e-3)
    middle = (columns.mean() + 0.5) / _SUB, (rows.mean() + 0.5) / _SUB
    assert middle == pytest.approx((true.x, true.y), abs=0.05)

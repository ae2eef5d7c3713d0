from __future__ import annotations

import numpy as np

from tests.cluttered import Plan
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

from __future__ import annotations

import time
from typing import cast

import pytest

from tests.bench import rows
from tests.bench.rows import Rows, bears, measure, report


def test_medians_are_of_each_database(monkeypatch: pytest.MonkeyPatch) -> None:
    small, large = cast(Rows, "small"), cast(Rows, "large")
    took = {"small": iter([1.0, 9.0, 2.0]), "large": iter([3.0, 5.0, 4.0])}
    clock = [0.0]

    def work(of: Rows) -> None:
        clock[0] += next(took[str(of)])

    monkeypatch.setattr(time, "perf_counter", lambda: clock[0])
    monkeypatch.setattr(rows, "OPERATIONS", {"work": work})
    assert measure(small, large, rounds=3) == {"work": (2.0, 4.0)}


@pytest.mark.parametrize(
    ("many", "borne"), [(0.001, True), (0.002, True), (0.0021, False), (1.0, False)]
)
def test_twice_as_much_is_borne(many: float, borne: bool) -> None:
    assert bears({"claim": (0.001, 0.001), "accept": (0.001, many)}) is borne


def test_a_quota_of_bytes_alone_may_grow() -> None:
    assert bears({"claim": (0.001, 0.001), "quota of bytes": (0.001, 1.0)})


def test_the_table_has_milliseconds_and_ratios() -> None:
    assert report({"claim": (0.0105, 0.0126)}, 1000, 1_000_000).splitlines() == [
        "| | 1,000 rows, ms | 1,000,000 rows, ms | ratio |",
        "|---|---:|---:|---:|",
        "| claim | 10.50 | 12.60 | 1.20 |",
    ]

from __future__ import annotations

import pytest

from tests.bench.load import accepted, speedup


def test_uploads_are_told_by_quantiles_and_rate() -> None:
    waited = [number / 100 for number in range(101)]  # 0 to 1 s
    assert accepted(8, waited, 10.1, 131.6) == "| 8 | 101 | 0.50 | 0.99 | 10.0 | 132 |"


def test_uploads_at_once_take_less_than_their_waits_together() -> None:
    row = accepted(2, [2.0, 2.0], 2.0, 100)
    assert row == "| 2 | 2 | 2.00 | 2.00 | 1.0 | 100 |"


@pytest.mark.parametrize(
    ("seconds", "told"),
    [([20.0, 10.0], "| 20.0 | 10.0 | 2.00 |"), ([18.0, 10.0], "| 18.0 | 10.0 | 1.80 |")],
)
def test_two_are_told_against_one(seconds: list[float], told: str) -> None:
    assert speedup("workers", seconds) == f"| workers | 8 {told}"

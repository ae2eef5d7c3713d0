"""The arithmetic of the long run: what it would say of sessions that went wrong."""

from __future__ import annotations

from typing import Any

import pytest

from tests.tether.bench import shares
from tests.tether.session import (
    Diary,
    Release,
    Verdict,
    Visit,
    divide,
    growth,
    judge,
    overheads,
    quantile,
)

RELEASES = [
    Release(number, number % 2 == 0, [f"d{number}"], own_s=0.25, at=number)
    for number in range(1, 5)
]


def job(no_flash: str, flash: str, state: str = "succeeded") -> dict[str, Any]:
    inputs = {"no_flash": {"sha256": no_flash}, "flash": {"sha256": flash}}
    return {"state": state, "inputs": inputs}


def ended(no_flash: str, flash: str, finished: str) -> dict[str, Any]:
    return job(no_flash, flash) | {"finished": finished}


@pytest.mark.parametrize(
    ("jobs", "verdict"),
    [
        ([job("d1", "d2"), job("d3", "d4")], Verdict(2, 0, 0, 0)),
        ([job("d1", "d2"), job("d3", "d4", "failed")], Verdict(1, 1, 0, 0)),
        ([{"state": "succeeded", "inputs": None}], Verdict(0, 1, 0, 0)),
        ([job("d2", "d1")], Verdict(0, 0, 1, 0)),
        ([job("d1", "d4")], Verdict(0, 0, 0, 1)),
        ([job("d2", "d3")], Verdict(0, 0, 1, 0)),
        ([job("d1", "d1")], Verdict(0, 0, 0, 1)),
        ([job("d1", "d2"), job("d1", "d2")], Verdict(1, 0, 0, 1)),
        ([job("d1", "unknown")], Verdict(0, 0, 0, 1)),
    ],
)
def test_each_kind_of_wrong_pair_is_told(jobs: list[dict[str, Any]], verdict: Verdict) -> None:
    assert judge(jobs, RELEASES) == verdict


def test_what_the_camera_needs_itself_is_not_ours() -> None:
    diary = Diary(RELEASES, [Visit(0.5, 2.25), Visit(2.5, 4.125), Visit(5.0, 5.5)])
    assert overheads(diary) == [1.25, 1.125, 0.5]


def test_the_time_of_a_pair_is_divided_without_a_rest() -> None:
    diary = Diary(RELEASES, [Visit(0.5, 2.25), Visit(2.75, 4.25)])
    jobs = [ended("d1", "d2", "1970-01-01T00:00:03Z"), ended("d3", "d4", "1970-01-01T00:00:05Z")]
    parts = divide(jobs, diary, overheads(diary))
    assert list(parts.values()) == [[0.5], [0.5], [1.0], [0.75]]
    assert sum(seconds for (seconds,) in parts.values()) == 5.0 - 2.25


def test_a_visit_without_a_job_ends_none() -> None:
    jobs = [ended("d1", "d2", "1970-01-01T00:00:03Z"), {"inputs": None, "finished": None}]
    diary = Diary(RELEASES, [Visit(0.5, 2.25), Visit(2.75, 4.25)])
    assert list(divide(jobs, diary, overheads(diary)).values()) == [[0.5], [0.5], [1.0], []]


@pytest.mark.parametrize(
    ("samples", "more"),
    [
        ([9, 9, 5, 5, 5, 5, 5, 5, 5, 5], 0),  # what is loaded once does not count
        ([1, 1, 1, 1, 2, 2, 3, 3, 4, 4], 3),
        ([1, 2, 3], 0),
    ],
)
def test_growth_is_told_from_loading(samples: list[float], more: float) -> None:
    assert growth(samples) == more


def test_quantiles_are_values_that_were_met() -> None:
    assert quantile([3.0, 1.0, 2.0], 0.99) == 3.0
    assert quantile([3.0, 1.0, 2.0, 4.0], 0.5) == 3.0
    assert quantile([1.0], 0.0) == 1.0


def test_our_speed_is_told_by_that_of_a_bare_copy() -> None:
    assert shares([2.0, 4.0, 8.0], [1.0, 3.0, 9.0]) == (0.5, 0.75)

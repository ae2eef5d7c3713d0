from __future__ import annotations

import random

import pytest

from tests.hostile.photographs import damage, pairs
from tests.hostile.run import GROWTH_MIB, Outcome, growth


def test_a_run_is_told_in_one_line() -> None:
    outcome = Outcome(requests=10, server_errors=1, workers_lost=2, stuck=3, growth_mib=4.25)
    assert outcome.line() == (
        "hostile: requests=10 server_errors=1 workers_lost=2 stuck=3 growth_mib=4.2"
    )


@pytest.mark.parametrize(
    ("outcome", "broken"),
    [
        (Outcome(requests=10), False),
        (Outcome(server_errors=1), True),
        (Outcome(workers_lost=1), True),
        (Outcome(stuck=1), True),
        (Outcome(growth_mib=GROWTH_MIB), False),
        (Outcome(growth_mib=GROWTH_MIB + 1), True),
    ],
)
def test_every_fault_breaks_a_run(outcome: Outcome, broken: bool) -> None:
    assert outcome.broken is broken


def test_the_same_seed_does_the_same_damage() -> None:
    data = pairs()["png"][0]
    first = [damage(random.Random(seed), data) for seed in range(50)]
    assert first == [damage(random.Random(seed), data) for seed in range(50)]
    assert sum(damaged != data for damaged in first) > 45


def test_growth_is_of_medians_from_a_tenth_on() -> None:
    held = [(0.05, 10.0), (0.1, 50.0), (0.15, 60.0), (0.19, 55.0), (0.5, 500.0)]
    held += [(0.9, 70.0), (0.95, 65.0), (1.0, 75.0)]
    assert growth([(share, {"api": api, "worker": 100.0}) for share, api in held]) == 15


def test_who_grew_most_is_told() -> None:
    looks = [(0.1, {"api": 5.0, "worker": 7.0}), (1.0, {"api": 4.0, "worker": 10.0})]
    assert growth(looks) == 3
    assert growth([(0.1, {"api": 5.0, "worker": 7.0}), (1.0, {"api": 4.0})]) == -1


def test_a_run_too_short_to_be_looked_at_early_begins_with_its_first_look() -> None:
    assert growth([(0.05, {"api": 1.0}), (0.6, {"api": 20.0}), (1.0, {"api": 23.0})]) == 3
    assert growth([(1.0, {"api": 23.0})]) == 0

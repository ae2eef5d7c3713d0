from __future__ import annotations

import random

import pytest

from tests.hostile.photographs import damage, pairs
from tests.hostile.run import GROWTH_MIB, Outcome


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

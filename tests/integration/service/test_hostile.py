"""The short form of python -m tests.hostile."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.hostile.run import GROWTH_MIB, Run
from tests.hostile.target import Target


@pytest.mark.timeout(1200)  # it waits for its jobs for 900 s at most
def test_hostile_requests_break_nothing(tmp_path: Path) -> None:
    target = Target(tmp_path)
    try:
        outcome = Run(target, requests=200, seed=2).go()
    finally:
        target.close()
    assert outcome.faults == []
    assert not outcome.broken, outcome.line()
    assert outcome.requests >= 200
    assert abs(outcome.growth_mib) < GROWTH_MIB  # a number, too
    # Nothing above would be told by a service that refused all of it at the door.
    assert outcome.jobs > 0
    assert {200, 201, 202, 400, 404, 422} <= set(outcome.statuses)
    assert "Traceback" not in target.log()

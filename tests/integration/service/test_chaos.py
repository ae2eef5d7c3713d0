"""The short form of `make chaos`, with quick heartbeats."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.postgresql import find_programs


@pytest.mark.timeout(900)  # what it waits for is longer in all than that of other tests
@pytest.mark.parametrize(("setup", "seed"), [("sqlite", 7), ("postgresql", 2)])
def test_nothing_is_lost_stuck_doubled_or_left_over(
    setup: str, seed: int, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    if setup == "postgresql" and find_programs() is None:
        request.getfixturevalue("lacking")("postgresql")
    quick = {"LIGHTLAYERS_HEARTBEAT_SECONDS": "0.5", "LIGHTLAYERS_SILENCE_SECONDS": "3"}
    environment = {**os.environ, **quick, "TMPDIR": str(tmp_path)}
    command = [sys.executable, "-m", "tests.chaos", "--setup", setup]
    done = subprocess.run(
        [*command, "--jobs", "7", "--faults", "5", "--lights", "2", "--seed", str(seed)],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    account = f"chaos: setup={setup} jobs=7 faults=5 lost=0 stuck=0 doubled=0 orphans=0 "
    assert done.stdout.splitlines()[-1].startswith(account)

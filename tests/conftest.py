"""Helpers of all tests."""

from __future__ import annotations

import os
from collections.abc import Callable
from datetime import datetime
from typing import NoReturn

import pytest

from drivers.clock import Clock

# before numpy loads: its threads wait for each other where other programs keep the processors busy,
# and small matrices then take twenty times as long
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# hundreds of processes start, each of which would compile our modules anew
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
# what the pipeline reads from outside: cameras beside the packaged ones, a limit of its own
for _name in ("LIGHTLAYERS_SPECTRA", "LIGHTLAYERS_MAX_PIXELS"):
    os.environ.pop(_name, None)


@pytest.fixture(scope="session")
def lacking() -> Callable[[str], NoReturn]:
    """End a test that needs a program this machine lacks; continuous integration lacks nothing."""

    def end(program: str) -> NoReturn:
        reason = f"{program} is not installed"
        if os.environ.get("CI") == "true":
            pytest.fail(reason)
        pytest.skip(reason)

    return end


class SteppedClock:
    """Time that passes only while somebody waits."""

    def __init__(self) -> None:
        self._seconds = 0.0

    def monotonic(self) -> float:
        return self._seconds

    def sleep(self, seconds: float) -> None:
        self._seconds += seconds

    def now(self) -> datetime:
        return datetime(2024, 2, 29, 23, 59, 58)


@pytest.fixture
def clock() -> Clock:
    """A clock for cameras, so that no test waits."""
    return SteppedClock()

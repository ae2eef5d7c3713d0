from __future__ import annotations

from datetime import datetime

import pytest

from drivers.clock import Clock


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
    return SteppedClock()

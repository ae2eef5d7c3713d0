"""Time as the drivers see it; a test or a simulation brings its own."""

from __future__ import annotations

import time
from datetime import datetime
from typing import Protocol


class Clock(Protocol):
    """Something to wait with."""

    def monotonic(self) -> float:
        """Seconds that only ever grow."""

    def sleep(self, seconds: float) -> None:
        """Let that many seconds pass."""

    def now(self) -> datetime:
        """Local date and time, as a camera would write into EXIF."""


class SystemClock:
    """The computer's own clock."""

    def monotonic(self) -> float:
        """Seconds that only ever grow."""
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        """Let that many seconds pass."""
        time.sleep(seconds)

    def now(self) -> datetime:
        """Local date and time."""
        return datetime.now()

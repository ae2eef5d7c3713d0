"""How long the stages of an attempt take: for its row, for the metrics and for the traces."""

from __future__ import annotations

import time
from collections.abc import Callable

from opentelemetry.trace import Span

from service import counters, tracing


class Stages:
    """The stages of one attempt, each measured from its beginning to that of the next."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        """Begin with none; clock: seconds."""
        self.seconds: dict[str, float] = {}
        """What each stage that is over took."""
        self._clock = clock
        self._running: tuple[str, float, Span] | None = None

    def enter(self, stage: str) -> None:
        """Say that a stage runs; the first time, it begins."""
        if self._running is None or self._running[0] != stage:
            self.end()
            self._running = stage, self._clock(), tracing.begin(stage)

    def end(self) -> None:
        """Say that the last one is over."""
        if self._running:
            stage, began, span = self._running
            spent = self._clock() - began
            self.seconds[stage] = round(self.seconds.get(stage, 0.0) + spent, 3)
            counters.STAGE_SECONDS.labels(stage).observe(spent)
            span.end()
            self._running = None

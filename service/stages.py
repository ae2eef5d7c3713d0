"""How long the stages of an attempt take: for the metrics and for the traces."""

from __future__ import annotations

import time

from opentelemetry.trace import Span

from service import metrics, tracing


class Stages:
    """The stages of one attempt, each measured from its beginning to that of the next."""

    def __init__(self) -> None:
        self._running: tuple[str, float, Span] | None = None

    def enter(self, stage: str) -> None:
        """Say that a stage runs; the first time, it begins."""
        if self._running is None or self._running[0] != stage:
            self.end()
            self._running = stage, time.monotonic(), tracing.begin(stage)

    def end(self) -> None:
        """Say that the last one is over."""
        if self._running:
            stage, began, span = self._running
            metrics.STAGE_SECONDS.labels(stage).observe(time.monotonic() - began)
            span.end()
            self._running = None

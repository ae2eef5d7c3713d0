"""Progress and cancellation: how a long run stays watchable."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from pipeline.errors import Canceled
from pipeline.images.strips import strips

STAGES = ("decode", "align", "lamps", "layers", "encode")
"""The stages of a separation, in order. A calibration has decode, align and calibrate."""

Tick = Callable[[], None]
"""Tells that a part of some work begins. Raises Canceled."""


class Progress:
    """Tells a caller how far a run is and asks whether to go on.

    callback(stage, fraction): stage is what is being done, fraction runs from 0 to 1 within it.
    canceled(): true when the run should stop.
    """

    def __init__(
        self,
        callback: Callable[[str, float], None] = lambda _stage, _fraction: None,
        canceled: Callable[[], bool] = lambda: False,
    ) -> None:
        self._callback = callback
        self._canceled = canceled

    def report(self, stage: str, fraction: float) -> None:
        """Report the fraction of a stage done. Raises Canceled when the caller wants to stop."""
        if self._canceled():
            raise Canceled("The job was canceled.")
        self._callback(stage, min(max(fraction, 0.0), 1.0))

    def ticks(self, stage: str, start: float, end: float, most: int) -> Tick:
        """Make a function that reports from start towards end, which it reaches after so many."""
        done = 0

        def tick() -> None:
            nonlocal done
            self.report(stage, start + (end - start) * min(done / most, 1.0))
            done += 1

        return tick

    def strips(
        self, stage: str, height: int, rows: int, start: float = 0.0, end: float = 1.0
    ) -> Iterator[slice]:
        """Row slices that cover 0…height, with a report from start to end of the stage."""
        for strip in strips(height, rows):
            self.report(stage, start + (end - start) * strip.start / height)
            yield strip
        self.report(stage, end)

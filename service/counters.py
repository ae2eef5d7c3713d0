"""What this process has done, counted as it does it; service.metrics serves it."""

from __future__ import annotations

from prometheus_client import Counter, Histogram

_STAGE_SECONDS = (0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500)

ACCEPTED = Counter("lightlayers_jobs_accepted", "Jobs that this process accepted.")
FINISHED = Counter("lightlayers_jobs_finished", "Jobs that this process ended.", ["outcome"])
STAGE_SECONDS = Histogram(
    "lightlayers_stage_seconds",
    "Time that stages of jobs took in this process.",
    ["stage"],
    buckets=_STAGE_SECONDS,
)
TAKEOVERS = Counter(
    "lightlayers_takeovers",
    "Jobs that this process put back into the queue, of workers that died with them in hand.",
)
STORE_ERRORS = Counter("lightlayers_store_errors", "Times that the store failed this process.")

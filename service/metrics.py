"""Figures for Prometheus, on a port of their own, in API and worker processes.

What a process has done is counted as it does it. What is in the database is asked for whenever
somebody looks, so that every process tells the same.
"""

from __future__ import annotations

from collections.abc import Iterator

import sqlalchemy as sa
from prometheus_client import REGISTRY, Counter, Histogram, start_http_server
from prometheus_client.core import GaugeMetricFamily
from prometheus_client.registry import Collector

from pipeline.errors import reason_of
from service.errors import StartError
from service.problems import STORE_AWAY, kind_of
from service.rows import census
from service.settings import Settings

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


def count_fault(error: Exception) -> None:
    """Count what went wrong, where a metric is about it."""
    if kind_of(error) is STORE_AWAY:
        STORE_ERRORS.inc()


class Database(Collector):
    """What the database says, asked for at every look."""

    def __init__(self, engine: sa.Engine, silence_seconds: float) -> None:
        self._engine = engine
        self._silence_seconds = silence_seconds

    def describe(self) -> list[GaugeMetricFamily]:
        """Name nothing beforehand: that would ask the database at the start."""
        return []

    def collect(self) -> Iterator[GaugeMetricFamily]:
        """Ask the database."""
        up = GaugeMetricFamily("lightlayers_database_up", "Whether the database answers.")
        try:
            with self._engine.connect() as connection:
                states = census.jobs_by_state(connection)
                wait = census.longest_wait(connection)
                workers = census.living_workers(connection, self._silence_seconds)
        except sa.exc.SQLAlchemyError:
            up.add_metric([], 0)
            yield up
            return
        up.add_metric([], 1)
        yield up
        jobs = GaugeMetricFamily(
            "lightlayers_jobs", "Jobs in the database by their state.", labels=["state"]
        )
        for state, count in states.items():
            jobs.add_metric([state.value], count)
        yield jobs
        oldest = "Time that the oldest job has waited for a worker."
        yield GaugeMetricFamily("lightlayers_queue_oldest_seconds", oldest, value=wait)
        yield GaugeMetricFamily("lightlayers_workers", "Workers that live.", value=workers)


def serve(settings: Settings, engine: sa.Engine) -> None:
    """Serve the figures of this process, where a port is set, until it ends. Raises StartError."""
    if settings.metrics_port is None:
        return
    REGISTRY.register(Database(engine, settings.silence_seconds))
    try:
        start_http_server(settings.metrics_port, settings.metrics_host)
    except OSError as error:
        raise StartError(
            f"Port {settings.metrics_port} of {settings.metrics_host} cannot be listened on: "
            f"{reason_of(error)}; set another LIGHTLAYERS_METRICS_PORT or LIGHTLAYERS_METRICS_HOST."
        ) from error

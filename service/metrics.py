"""Figures for Prometheus, on a port of their own, in API and worker processes.

What a process has done is in its counters. What is in the database is asked for whenever somebody
looks, so that every process tells the same.
"""

from __future__ import annotations

from collections.abc import Iterator

import sqlalchemy as sa
from prometheus_client import REGISTRY, start_http_server
from prometheus_client.core import GaugeMetricFamily
from prometheus_client.registry import Collector

from pipeline.errors import reason_of
from service import counters
from service.errors import StartError
from service.problems import STORE_AWAY, kind_of
from service.rows import census
from service.settings import Settings


def count_fault(error: Exception) -> None:
    """Count an error that is the store's failure; no metric tells of others."""
    if kind_of(error) is STORE_AWAY:
        counters.STORE_ERRORS.inc()


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

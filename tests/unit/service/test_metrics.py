from __future__ import annotations

import socket
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa
from obstore.exceptions import GenericError
from prometheus_client import REGISTRY, CollectorRegistry, generate_latest

from service import metrics
from service.errors import MalformedRequestError, StartError
from service.rows import attempts, heartbeats, jobs, tables
from service.settings import Settings


def _add(engine: sa.Engine, job_id: str) -> None:
    values: dict[str, Any] = {
        "id": job_id,
        "options": {},
        "trace_id": "1" * 32,
        "request_hash": "",
    }
    with engine.begin() as connection:
        jobs.add(connection, values)


def _told(engine: sa.Engine) -> list[str]:
    registry = CollectorRegistry()
    registry.register(metrics.Database(engine, 15))
    lines = generate_latest(registry).decode().splitlines()
    return [line for line in lines if not line.startswith("#")]


def _count(name: str, **labels: str) -> float:
    return REGISTRY.get_sample_value(name, labels) or 0.0


def test_what_is_in_the_database_is_asked_for_at_each_look(engine: sa.Engine) -> None:
    empty = _told(engine)
    assert {"lightlayers_queue_oldest_seconds 0.0", "lightlayers_workers 0.0"} <= set(empty)
    _add(engine, "a")
    _add(engine, "b")
    with engine.begin() as connection:
        heartbeats.beat(connection, "w")
        attempts.claim(connection, "b", "w")
        connection.execute(sa.update(tables.jobs).values(created=tables.jobs.c.created - 60))
    told = dict(line.rsplit(" ", 1) for line in _told(engine))
    assert told["lightlayers_database_up"] == "1.0"
    assert told['lightlayers_jobs{state="queued"}'] == "1.0"
    assert told['lightlayers_jobs{state="running"}'] == "1.0"
    assert told['lightlayers_jobs{state="failed"}'] == "0.0"
    assert told["lightlayers_workers"] == "1.0"
    assert 60 <= float(told["lightlayers_queue_oldest_seconds"]) < 120


def test_a_database_that_is_away_is_a_figure_itself(engine: sa.Engine) -> None:
    with engine.begin() as connection:
        connection.exec_driver_sql("ALTER TABLE workers RENAME TO gone")
    assert _told(engine) == ["lightlayers_database_up 0.0"]


def test_jobs_count_when_they_come_and_when_they_end(engine: sa.Engine) -> None:
    accepted = _count("lightlayers_jobs_accepted_total")
    canceled = _count("lightlayers_jobs_finished_total", outcome="canceled")
    failed = _count("lightlayers_jobs_finished_total", outcome="failed")
    _add(engine, "a")
    _add(engine, "b")
    with engine.begin() as connection:
        jobs.request_cancel(connection, "a")
        jobs.request_cancel(connection, "a")
        held = attempts.claim(connection, "b", "w")
        assert held is not None
        assert attempts.fail(connection, held, {})
        assert not attempts.fail(connection, held, {})
    assert _count("lightlayers_jobs_accepted_total") == accepted + 2
    assert _count("lightlayers_jobs_finished_total", outcome="canceled") == canceled + 1
    assert _count("lightlayers_jobs_finished_total", outcome="failed") == failed + 1


def test_each_job_of_a_burst_counts(engine: sa.Engine) -> None:
    accepted = _count("lightlayers_jobs_accepted_total")
    row = {"options": {}, "trace_id": "1" * 32, "request_hash": ""}
    with engine.begin() as connection:
        ranks = jobs.add_burst(connection, [({"id": job_id, **row}, None) for job_id in "abc"])
    assert ranks == [4, 8, 12]
    assert _count("lightlayers_jobs_accepted_total") == accepted + 3


def test_what_is_rolled_back_does_not_count(engine: sa.Engine) -> None:
    _add(engine, "a")
    names = "lightlayers_jobs_accepted_total", "lightlayers_jobs_finished_total"
    before = _count(names[0]), _count(names[1], outcome="canceled")
    with pytest.raises(sa.exc.IntegrityError), engine.begin() as connection:
        jobs.request_cancel(connection, "a")
        row = {"options": {}, "trace_id": "1" * 32, "request_hash": ""}
        jobs.add(connection, {"id": "b", **row})
        jobs.add(connection, {"id": "a", **row})
    with engine.connect() as connection:  # ended without a commit
        jobs.add(connection, {"id": "b", **row})
    assert (_count(names[0]), _count(names[1], outcome="canceled")) == before
    with engine.begin() as connection:  # the same connection of the pool
        jobs.request_cancel(connection, "a")
        assert _count(names[1], outcome="canceled") == before[1]
    assert (_count(names[0]), _count(names[1], outcome="canceled")) == (before[0], before[1] + 1)


def test_only_faults_of_the_store_are_the_stores() -> None:
    before = _count("lightlayers_store_errors_total")
    metrics.count_fault(MalformedRequestError("no"))
    assert _count("lightlayers_store_errors_total") == before
    metrics.count_fault(GenericError("away"))
    assert _count("lightlayers_store_errors_total") == before + 1


def test_a_port_in_use_is_told(engine: sa.Engine) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        settings = Settings(metrics_port=other.getsockname()[1])
        with pytest.raises(StartError, match="METRICS_PORT or LIGHTLAYERS_METRICS_HOST"):
            metrics.serve(settings, engine)


def test_without_a_port_nothing_listens(engine: sa.Engine, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(metrics, "start_http_server", pytest.fail)
    metrics.serve(Settings(), engine)


def test_the_guide_names_every_metric(engine: sa.Engine) -> None:
    guide = (Path(__file__).parents[3] / "docs/operating.md").read_text()
    families = [*REGISTRY.collect(), *metrics.Database(engine, 15).collect()]
    ours = {family.name for family in families if family.name.startswith("lightlayers_")}
    assert len(ours) == 9
    for name in ours:
        assert f"| `{name}" in guide

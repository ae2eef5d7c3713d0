from __future__ import annotations

import json
import logging
from collections.abc import Iterator
from types import SimpleNamespace

import psycopg
import pytest
import sqlalchemy as sa

from service import logs
from service.dbos_queue import outages

_REFUSED = "connection failed: refused\nIs it running?"
_AWAY = [
    sa.exc.OperationalError("SELECT secret FROM queues", {}, Exception(_REFUSED)),
    psycopg.OperationalError(_REFUSED),
]


@pytest.fixture
def dbos_log(monkeypatch: pytest.MonkeyPatch) -> Iterator[logging.Logger]:
    """The logger of DBOS as it is before a worker starts."""
    root, dbos = logging.getLogger(), logging.getLogger("dbos")
    handlers, level, ours = root.handlers[:], root.level, logging.getLogger("service").level
    monkeypatch.setattr(dbos, "filters", [])
    monkeypatch.setattr(dbos, "handlers", [logging.NullHandler()])
    yield dbos
    root.handlers[:] = handlers
    root.setLevel(level)
    logging.getLogger("service").setLevel(ours)


def _start() -> None:
    """Do what a worker does, once what is written is seen."""
    logs.configure()
    outages.shorten_outages("host-1")


def _fail(log: logging.Logger, error: Exception) -> None:
    try:
        raise error
    except Exception as caught:
        log.warning(f"Exception encountered in queue thread for jobs: {caught}", exc_info=True)


@pytest.mark.parametrize("error", _AWAY)
def test_an_outage_is_one_line_each_ten_seconds_with_the_cause_and_no_statement(
    error: Exception,
    dbos_log: logging.Logger,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    seconds = iter([100.0, 100.0, 100.1, 109.9, 110.0, 110.0])
    clock = SimpleNamespace(monotonic=lambda: next(seconds))
    monkeypatch.setattr(outages, "time", clock)
    _start()
    for _ in range(4):
        _fail(dbos_log, error)
    lines = [json.loads(line) for line in capsys.readouterr().err.splitlines()]
    assert [line["message"] for line in lines] == [
        "the queue is hindered, database-unavailable: connection failed: refused"
    ] * 2
    assert {(line["worker"], line["logger"]) for line in lines} == {("host-1", "dbos")}
    assert not any("traceback" in line for line in lines)


def test_what_else_the_queue_says_is_told_as_it_is(
    dbos_log: logging.Logger, capsys: pytest.CaptureFixture[str]
) -> None:
    _start()
    _fail(dbos_log, _AWAY[0])
    _fail(dbos_log, ValueError("broken"))
    dbos_log.warning("something odd")
    lines = [json.loads(line) for line in capsys.readouterr().err.splitlines()]
    assert [line["message"] for line in lines][1:] == [
        "Exception encountered in queue thread for jobs: broken",
        "something odd",
    ]
    assert "traceback" in lines[1]

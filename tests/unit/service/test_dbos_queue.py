from __future__ import annotations

import json
import logging
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import psycopg
import pytest
import sqlalchemy as sa

from service import dbos_queue, logs
from service.opening import open_database
from service.settings import Settings

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


def test_an_id_in_the_queue_of_jobs_tells_the_job_and_how_often_it_was_put_back() -> None:
    ids = [dbos_queue.run_id("a1", again) for again in (0, 1, 30)]
    assert ids == ["a1", "a1-again-1", "a1-again-30"]
    assert [dbos_queue._again(queued) for queued in ids] == [0, 1, 30]
    held = [dbos_queue.Held(queued, "w", dbos_queue.JOBS) for queued in ids]
    assert {(one.job, one.work, one.runs) for one in held} == {("a1", "a1", True)}
    capture = dbos_queue.Held(dbos_queue.capture_id("a1"), "w", dbos_queue.CAPTURES)
    assert (capture.job, capture.work) == ("a1", "a1-capture")


def _start() -> None:
    """Do what a worker does, once what is written is seen."""
    logs.configure()
    dbos_queue._listen_to_dbos("host-1")


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
    monkeypatch.setattr("service.dbos_queue.time", clock)
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


def _sweeps(engine: sa.Engine) -> set[str]:
    """Those that wait, by their ids."""
    query = "SELECT workflow_uuid FROM workflow_status WHERE queue_name = 'upkeep'"
    with engine.connect() as connection:
        return set(connection.execute(sa.text(query)).scalars())


def test_a_database_whose_clock_is_set_back_or_forward_has_one_sweep_for_each_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    engine = open_database(Settings(data_dir=tmp_path))
    queue = dbos_queue.Queue(engine)
    day = 86400.0
    for moment in (10 * day, 10 * day + 59, 10 * day + 60, 9 * day, 12 * day):
        monkeypatch.setattr(dbos_queue, "now", lambda moment=moment: sa.literal(moment))
        with engine.begin() as connection:
            queue.submit_sweep(connection, 60, thorough=False)
            queue.submit_sweep(connection, 3600, thorough=True)
    queue.close()
    assert _sweeps(engine) == {
        *(f"sweep-often-{minute}" for minute in (14400, 14401, 12960, 17280)),
        *(f"sweep-thorough-{hour}" for hour in (240, 216, 288)),
    }
    engine.dispose()


@pytest.mark.parametrize("failure", [_AWAY[0], ValueError("a fault of ours")])
def test_sweeps_are_called_again_after_what_hindered_one(
    failure: Exception,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    engine = open_database(Settings(data_dir=tmp_path))
    answers = iter([sa.literal(0.0), sa.literal(0.0), None, sa.literal(90.0), sa.literal(90.0)])

    def now() -> sa.ColumnElement[float]:
        answer = next(answers)
        if answer is None:
            raise failure
        return answer

    def sleep(_seconds: float) -> None:
        if len(_sweeps(engine)) == 3:
            raise KeyboardInterrupt

    monkeypatch.setattr(dbos_queue, "now", now)
    monkeypatch.setattr(dbos_queue, "time", SimpleNamespace(sleep=sleep))
    with pytest.raises(KeyboardInterrupt):
        dbos_queue._call_sweeps(dbos_queue.Queue(engine), engine, "host-1", 60)
    assert _sweeps(engine) == {"sweep-often-0", "sweep-thorough-0", "sweep-often-1"}
    [line] = [line for line in caplog.records if line.name == "service.dbos_queue"]
    assert line.message.startswith("no sweep was called for")
    assert vars(line)["worker"] == "host-1"
    engine.dispose()

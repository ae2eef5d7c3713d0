from __future__ import annotations

from types import SimpleNamespace

import pytest
import sqlalchemy as sa

from service.dbos_queue import queue as queues
from service.dbos_queue import sweeps
from service.dbos_queue.queue import Queue

_AWAY = sa.exc.OperationalError("SELECT secret FROM queues", {}, Exception("connection refused"))


def _sweeps(engine: sa.Engine) -> set[str]:
    """Those that wait, by their ids."""
    query = "SELECT workflow_uuid FROM workflow_status WHERE queue_name = 'upkeep'"
    with engine.connect() as connection:
        return set(connection.execute(sa.text(query)).scalars())


def test_a_database_whose_clock_is_set_back_or_forward_has_one_sweep_for_each_time(
    engine: sa.Engine, monkeypatch: pytest.MonkeyPatch
) -> None:
    queue = Queue(engine)
    day = 86400.0
    for moment in (10 * day, 10 * day + 59, 10 * day + 60, 9 * day, 12 * day):
        monkeypatch.setattr(queues, "now", lambda moment=moment: sa.literal(moment))
        with engine.begin() as connection:
            queue.submit_sweep(connection, 60, thorough=False)
            queue.submit_sweep(connection, 3600, thorough=True)
    queue.close()
    assert _sweeps(engine) == {
        *(f"sweep-often-{minute}" for minute in (14400, 14401, 12960, 17280)),
        *(f"sweep-thorough-{hour}" for hour in (240, 216, 288)),
    }


@pytest.mark.parametrize("failure", [_AWAY, ValueError("a fault of ours")])
def test_sweeps_are_called_again_after_what_hindered_one(
    failure: Exception,
    engine: sa.Engine,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    answers = iter([sa.literal(0.0), sa.literal(0.0), None, sa.literal(90.0), sa.literal(90.0)])

    def now() -> sa.ColumnElement[float]:
        answer = next(answers)
        if answer is None:
            raise failure
        return answer

    def sleep(_seconds: float) -> None:
        if len(_sweeps(engine)) == 3:
            raise KeyboardInterrupt

    monkeypatch.setattr(queues, "now", now)
    monkeypatch.setattr(sweeps, "time", SimpleNamespace(sleep=sleep))
    with pytest.raises(KeyboardInterrupt):
        sweeps.call_sweeps(Queue(engine), engine, "host-1", 60)
    assert _sweeps(engine) == {"sweep-often-0", "sweep-thorough-0", "sweep-often-1"}
    [line] = [line for line in caplog.records if line.name == "service.dbos_queue"]
    assert line.message.startswith("no sweep was called for")
    assert vars(line)["worker"] == "host-1"

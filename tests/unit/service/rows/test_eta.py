from __future__ import annotations

from typing import Any

import pytest
import sqlalchemy as sa

from service.rows import attempts, clock, eta, heartbeats, jobs, tables, waiting
from service.settings import Settings
from tests.plans import plans

CAPTURE = {"camera": "sim://studio"}


def _add(connection: sa.Connection, job_id: str, **values: Any) -> None:
    usual = {"id": job_id, "options": {}, "trace_id": "1" * 32, "request_hash": ""}
    jobs.add(connection, {**usual, "likeness": "best-best bytes-40", **values})


def _done(connection: sa.Connection, job_id: str, seconds: dict[str, float], **more: Any) -> None:
    _add(connection, job_id, **more)
    held = attempts.claim(connection, job_id, "w1")
    assert held is not None
    assert attempts.succeed(connection, held, [], seconds)


def _job(connection: sa.Connection, job_id: str) -> jobs.Job:
    job = jobs.find(connection, job_id)
    assert job is not None
    return job


def test_jobs_are_alike_by_kind_quality_and_size() -> None:
    usual = eta.likeness({"lights": 2}, 20_000_000, None)
    assert eta.likeness({}, 21_000_000, None) == usual
    others = [
        eta.likeness({}, 40_000_000, None),
        eta.likeness({"quality": "fast"}, 20_000_000, None),
        eta.likeness({"method": "paper"}, 20_000_000, None),
        eta.likeness({"light_directions": [{}]}, 20_000_000, None),
        eta.likeness({"response": "Nikon D5100"}, 20_000_000, None),
        eta.likeness({"kind": "flash"}, 20_000_000, None),
        eta.likeness({"kind": "camera"}, 20_000_000, None),
        eta.likeness({}, 0, CAPTURE),
        eta.likeness({}, 0, {"camera": "x" * 3000}),
    ]
    assert len({usual, *others}) == 10
    assert max(map(len, others)) <= 64


def test_a_pace_is_learnt_from_jobs_alike(connection: sa.Connection) -> None:
    for number, decode in enumerate((1.0, 2.0, 30.0)):
        _done(connection, str(number), {"decode": decode, "layers": decode * 3})
    _done(connection, "other", {"decode": 1000.0}, likeness="fast-best bytes-40")
    _add(connection, "a")
    pace = eta.pace_of(connection, _job(connection, "a"))
    assert pace.seconds == 8.0
    assert pace.progress("decode", 0.5) == pytest.approx(0.125)
    assert pace.progress("lamps", 1.0) == pytest.approx(0.25)
    assert pace.progress("layers", 0.5) == pytest.approx(0.625)
    assert pace.progress("store", 1.0) == pytest.approx(1.0)
    assert pace.progress("unheard of", 0.5) == 0.0


def test_only_the_last_jobs_count(connection: sa.Connection) -> None:
    for number in range(25):
        _done(connection, f"{number:02}", {"layers": 100.0 if number < 5 else 1.0})
        moved = sa.update(tables.jobs).where(tables.jobs.c.id == f"{number:02}")
        connection.execute(moved.values(created=float(number)))
    _add(connection, "a")
    pace = eta.pace_of(connection, _job(connection, "a"))
    assert pace.shares["layers"] == 1.0
    assert pace.seconds == 1.0


def test_without_jobs_alike_shares_are_rough_and_the_time_is_unknown(
    connection: sa.Connection,
) -> None:
    _add(connection, "separate")
    _add(connection, "capture", capture=CAPTURE)
    _add(connection, "calibrate", options={"kind": "flash"})
    for job_id in ("separate", "capture", "calibrate"):
        pace = eta.pace_of(connection, _job(connection, job_id))
        assert pace.seconds is None
        assert sum(pace.shares.values()) == pytest.approx(1)
        assert ("capture" in pace.shares) == (job_id == "capture")


def test_a_track_never_falls() -> None:
    pace = eta.Pace({"fetch": 0.1, "decode": 0.2, "layers": 0.6, "store": 0.1}, 20.0)
    track = eta.Track(pace)
    told = []
    for stage, fraction in [
        ("decode", 0),
        ("decode", 1),
        ("layers", 0),
        ("decode", 0),
        ("store", 0),
    ]:
        track.reach(stage, fraction)
        told.append(round(track.progress, 3))
        assert track.seconds_left == pytest.approx(20 * (1 - track.progress))
    assert told == [0.1, 0.3, 0.3, 0.3, 0.9]


def test_what_is_left_of_an_unknown_pace_is_unknown() -> None:
    assert eta.Track(eta.Pace({}, None)).seconds_left is None


def _etas(connection: sa.Connection, *shown: str, **settings: Any) -> dict[str, float]:
    found = [_job(connection, job_id) for job_id in shown]
    places = waiting.positions(connection, found)
    moment: float = connection.execute(sa.select(clock.now())).scalar_one()
    ends = eta.etas(connection, Settings(**settings), found, places)
    return {job_id: end - moment for job_id, end in ends.items()}


def test_a_running_job_ends_when_its_worker_says_until_that_has_passed(
    connection: sa.Connection,
) -> None:
    _add(connection, "a")
    held = attempts.claim(connection, "a", "w1")
    assert held is not None
    assert _etas(connection, "a") == {}
    attempts.report(connection, held, "layers", 0.5, 0.6, 40.0)
    assert _etas(connection, "a") == {"a": pytest.approx(40, abs=5)}
    attempts.report(connection, held, "layers", 0.5, 0.6, -1.0)
    assert _etas(connection, "a") == {}
    attempts.report(connection, held, "layers", 0.5, 0.6, 40.0)
    attempts.release(connection, held)
    released = _job(connection, "a")
    assert (released.eta, released.progress) == (None, 0.0)


def test_a_waiting_job_ends_after_those_before_it(connection: sa.Connection) -> None:
    heartbeats.beat(connection, "w1")
    _done(connection, "0", {"layers": 100.0})
    for job_id in "abc":
        _add(connection, job_id)
        moved = sa.update(tables.jobs).where(tables.jobs.c.id == job_id)
        connection.execute(moved.values(created=1e9 + ord(job_id)))
    _add(connection, "new kind", likeness="calibrate-flash bytes-40")
    assert attempts.claim(connection, "a", "w1")
    found = _etas(connection, "b", "c", "new kind")
    assert found == {"b": pytest.approx(150, abs=5), "c": pytest.approx(250, abs=5)}
    wide = _etas(connection, "b", "c", worker_concurrency=2)
    assert wide == {"b": pytest.approx(100, abs=5), "c": pytest.approx(175, abs=5)}
    heartbeats.beat(connection, "w2")
    assert _etas(connection, "b", "c") == wide | {
        name: pytest.approx(end, abs=5) for name, end in wide.items()
    }


def test_without_a_living_worker_nothing_is_promised(connection: sa.Connection) -> None:
    _done(connection, "0", {"layers": 100.0})
    _add(connection, "a")
    assert _etas(connection, "a") == {}
    heartbeats.beat(connection, "w1")
    assert _etas(connection, "a") == {"a": pytest.approx(100, abs=5)}
    connection.execute(sa.update(tables.workers).values(seen=0.0))
    assert _etas(connection, "a") == {}


def test_of_a_job_whose_place_is_not_known_no_end_is(connection: sa.Connection) -> None:
    """It was begun or canceled between the reading of its row and of the queue."""
    heartbeats.beat(connection, "w1")
    _done(connection, "0", {"layers": 100.0})
    for job_id in "ab":
        _add(connection, job_id)
    found = eta.etas(
        connection, Settings(), [_job(connection, "a"), _job(connection, "b")], {"b": 1}
    )
    assert set(found) == {"b"}


def test_the_last_jobs_are_found_by_an_index(engine: sa.Engine, connection: sa.Connection) -> None:
    heartbeats.beat(connection, "w1")
    _done(connection, "0", {"layers": 100.0})
    _add(connection, "a")
    with plans(engine) as found:
        assert _etas(connection, "a") == {"a": pytest.approx(100, abs=5)}
    for index in ("jobs_by_state (state=?)", "jobs_by_likeness (likeness=? AND state=?)"):
        (plan,) = (plan for plan in found if index in plan)
        assert "TEMP B-TREE" not in plan

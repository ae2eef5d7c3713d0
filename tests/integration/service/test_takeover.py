"""Jobs of a host that is frozen or cut off run again elsewhere, and end once."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import sqlite3
import subprocess
from collections.abc import Iterator
from typing import Any

import pytest
import sqlalchemy as sa

import drivers
from service.rows import database, tables
from service.storage.by_url import storage_at
from tests.chaos.relay import Relay
from tests.integration.service.real_service import Service


@pytest.fixture(scope="module")
def silence_seconds() -> float:
    """These wait for it, but until then no worker may seem dead."""
    return 5


@pytest.fixture(scope="module")
def _impatient(
    tmp_path_factory: pytest.TempPathFactory, silence_seconds: float
) -> Iterator[Service]:
    service = Service(tmp_path_factory.mktemp("impatient"), silence_seconds=silence_seconds)
    service.start()
    yield service
    service.close()


@pytest.fixture
def impatient(_impatient: Service) -> Iterator[Service]:
    """A service that takes the jobs of frozen workers over soon."""
    yield _impatient
    _impatient.tidy()


def _ends(service: Any, job: Any) -> list[str]:
    """Ends of a job by the log of all workers."""
    lines = [json.loads(line) for line in service.log.read_text().splitlines() if job["id"] in line]
    ends = ("succeeded", "failed", "canceled")
    return [line["message"] for line in lines if line["message"].startswith(ends)]


def _digests(service: Any, job: Any) -> dict[str, str]:
    return {file["name"]: file["sha256"] for file in service.look(job)["files"]}


def _freeze(service: Any, pids: list[int]) -> bool:
    """Freeze processes, unless one is writing: SQLite would stay locked for all others, too."""
    for pid in pids:
        os.kill(pid, signal.SIGSTOP)
    database = sqlite3.connect(service.data / "lightlayers.sqlite", isolation_level=None, timeout=1)
    with contextlib.closing(database), contextlib.suppress(sqlite3.OperationalError):
        database.execute("BEGIN IMMEDIATE")
        database.execute("ROLLBACK")
        return True
    for pid in pids:
        os.kill(pid, signal.SIGCONT)
    return False


@pytest.mark.parametrize("whole", [False, True], ids=["the worker alone", "its whole family"])
def test_a_frozen_worker_that_comes_back_changes_nothing(
    impatient: Service, small_pair: drivers.CapturedPair, whole: bool
) -> None:
    with impatient.held():
        job = impatient.upload(small_pair, lights=2)
        impatient.await_stage(job)
        (worker,) = impatient.find("worker")
        family = impatient.find("fork server") + impatient.find("child") if whole else []
        frozen = [worker, *family]
        impatient.await_that("they are frozen", lambda: _freeze(impatient, frozen))
    impatient.start_worker()
    done = impatient.await_end(job)
    assert (done["state"], done["attempt"]) == ("succeeded", 2)
    digests = _digests(impatient, job)
    for pid in frozen:
        os.kill(pid, signal.SIGCONT)
    # It finds that it counts no more, gives up, and is there for the next job.
    impatient.await_that("its process is gone", lambda: not impatient.find("child"))
    after = impatient.await_end(impatient.upload(small_pair, lights=2))
    assert after["state"] == "succeeded"
    now = impatient.look(job)
    assert (now["state"], now["attempt"], _digests(impatient, job)) == ("succeeded", 2, digests)
    assert _ends(impatient, job) == ["succeeded"]
    stored = storage_at((impatient.data / "store").as_uri()).list(f"jobs/{job['id']}/")
    assert {key.split("/")[2] for key in stored} == {"inputs", "2"}


def test_sweeps_go_by_the_clock_of_the_database_and_by_no_schedule(sweeping: Any) -> None:
    """Those of DBOS go by the host's clock, and wait for as long as that is set back."""
    database = sqlite3.connect(sweeping.data / "lightlayers.sqlite", timeout=60)
    done = "SELECT COUNT(*) FROM workflow_status WHERE name = 'sweep' AND status = 'SUCCESS'"
    sweeping.await_that("two sweeps are done", lambda: database.execute(done).fetchone()[0] > 1)
    schedules = database.execute("SELECT COUNT(*) FROM workflow_schedules").fetchone()
    database.close()
    assert schedules == (0,)


def test_a_sweep_of_which_the_worker_never_heard_is_done_again(sweeping: Any) -> None:
    """One is out of the queue at a time: nothing would be removed until that worker ends."""
    database = sqlite3.connect(
        sweeping.data / "lightlayers.sqlite", isolation_level=None, timeout=60
    )
    sweeps = "SELECT workflow_uuid, status FROM workflow_status WHERE queue_name = 'upkeep' "

    def done() -> tuple[str, str] | None:
        found: tuple[str, str] | None = database.execute(
            sweeps + "AND status = 'SUCCESS'"
        ).fetchone()
        return found

    sweeping.await_that("a sweep is done", done)
    found = done()
    assert found is not None
    sweep, _ = found
    database.execute(
        "UPDATE workflow_status SET status = 'PENDING', output = NULL, "
        "executor_id = (SELECT id FROM workers) WHERE workflow_uuid = ?",
        (sweep,),
    )
    sweeping.await_that(
        "it is done again",
        lambda: (
            database.execute(sweeps + "AND workflow_uuid = ?", (sweep,)).fetchone()
            == (sweep, "SUCCESS")
        ),
    )
    database.close()
    assert f'"put back", "job": "{sweep}"' in sweeping.log.read_text()


@pytest.fixture
def far_worker(grown_up: Service, shared_database: str) -> Iterator[Relay]:
    """A way to the database that can be cut, for workers that are started from now on."""
    url = sa.make_url(shared_database)
    assert url.port is not None
    relay = Relay(url.port)
    there = url.set(port=relay.port).render_as_string(hide_password=False)
    near = grown_up.environment
    grown_up.environment = near | {"LIGHTLAYERS_DATABASE_URL": there}
    yield relay
    grown_up.environment = near


@pytest.fixture
def cut_off(
    grown_up: Service, far_worker: Relay, small_pair: drivers.CapturedPair
) -> Iterator[tuple[subprocess.Popen[bytes], list[Any]]]:
    """A worker that has just lost the database, and two jobs, of which it is in one's middle.

    They are held there.
    """
    far = grown_up.start_ready_worker()  # one alone would have both jobs
    with grown_up.held():
        jobs = [grown_up.upload(small_pair, lights=2) for _ in range(2)]
        for job in jobs:
            grown_up.await_stage(job)
        far_worker.cut()
        yield far, jobs


def test_a_worker_that_is_cut_off_counts_no_more(
    grown_up: Service,
    far_worker: Relay,
    shared_database: str,
    cut_off: tuple[subprocess.Popen[bytes], list[Any]],
) -> None:
    far, jobs = cut_off
    grown_up.release()
    ends = [grown_up.await_end(job) for job in jobs]
    assert [job["state"] for job in ends] == ["succeeded"] * 2
    assert sorted(job["attempt"] for job in ends) == [1, 2]
    engine = database.connect(shared_database)

    def workers() -> int:
        with engine.connect() as connection:
            query = sa.select(sa.func.count()).select_from(tables.workers)
            return connection.execute(query).scalar_one()

    assert workers() == 1
    far_worker.mend()
    grown_up.await_that("it is back", lambda: workers() == 2)
    engine.dispose()
    assert far.poll() is None
    for job, end in zip(jobs, ends, strict=True):
        assert grown_up.look(job) == end
        assert _ends(grown_up, job) == ["succeeded"]


def _silent_ends(service: Service) -> int:
    return service.log.read_text().count("left without a word")


def test_a_worker_that_stops_while_the_database_is_away_ends_and_its_job_goes_on(
    grown_up: Service, cut_off: tuple[subprocess.Popen[bytes], list[Any]]
) -> None:
    far, jobs = cut_off
    before = _silent_ends(grown_up)
    far.terminate()
    assert far.wait(120) == 0
    grown_up.release()
    assert _silent_ends(grown_up) == before + 1
    ends = [grown_up.await_end(job) for job in jobs]
    assert sorted((job["state"], job["attempt"]) for job in ends) == [
        ("succeeded", 1),
        ("succeeded", 2),
    ]
    # the line comes after the row
    grown_up.await_that("both ends are logged", lambda: all(_ends(grown_up, job) for job in jobs))
    for job in jobs:
        assert _ends(grown_up, job) == ["succeeded"]


def test_a_job_outlasts_a_store_that_is_away_for_a_moment(
    grown_up: Service, store_relay: Relay, small_pair: drivers.CapturedPair
) -> None:
    def hindered() -> int:
        return grown_up.log.read_text().count("hindered")

    before = hindered()
    with grown_up.held():
        job = grown_up.upload(small_pair, lights=2)
        grown_up.await_stage(job)
        store_relay.cut()
    grown_up.await_that("the worker has tried", lambda: hindered() > before)
    assert grown_up.http.get("/readyz").status_code == 503
    assert grown_up.look(job)["state"] == "running"
    store_relay.mend()
    done = grown_up.await_end(job)
    assert (done["state"], done["attempt"]) == ("succeeded", 1)

from __future__ import annotations

import os
import time
from collections.abc import Callable

import httpx
import pytest
import sqlalchemy as sa
from obstore.exceptions import GenericError

from service import belonging
from service.api.context import Context
from service.frames import FRAMES
from service.object_keys import inputs_key, results_key
from service.retention import Sweep
from service.rows import attempts, cameras, deliveries, expiry, heartbeats, tables, uploads
from service.rows.states import State
from service.settings import Settings
from service.storage.base import Storage
from service.storage.folder import FolderStorage
from tests.unit.service.asking import post_capture, rows_of, stored_job
from tests.unit.service.full_disk import full_disk

Finish = Callable[[str, dict[str, bytes]], None]


@pytest.fixture
def settings(settings: Settings) -> Settings:
    return settings.model_copy(update={"retention_days": 2.0})


@pytest.fixture
def sweep(context: Context) -> Sweep:
    """Of a store that is its database's, as a service's is from its first start."""
    assert belonging.claim(context.engine, context.storage)
    return Sweep(context.engine, context.storage, context.queue, context.settings)


@pytest.fixture
def finished(context: Context, finish: Finish) -> Callable[[], str]:
    """Id of a new job that has succeeded."""

    def make() -> str:
        job_id = stored_job(context)
        finish(job_id, {"manifest.json": b"{}"})
        return job_id

    return make


def _files(context: Context) -> list[str]:
    """Keys of all files of jobs and uploads."""
    return [*context.storage.list("jobs/"), *context.storage.list("uploads/")]


def _expires(context: Context, job_id: str, when: float | None) -> None:
    with context.engine.begin() as connection:
        this = tables.jobs.c.id == job_id
        connection.execute(sa.update(tables.jobs).where(this).values(expires=when))


def test_a_job_past_its_time_goes_with_its_files_and_no_other(
    sweep: Sweep, finished: Callable[[], str], context: Context, http: httpx.Client
) -> None:
    old, new = finished(), finished()
    waiting = post_capture(http)["id"]
    _expires(context, old, time.time() - 1)
    _expires(context, new, time.time() + 60)
    _expires(context, waiting, time.time() - 1)
    sweep.run(thorough=False)
    assert {job.id for job in rows_of(context)} == {new, waiting}
    kept = [results_key(new, 1, "manifest.json")]
    kept += [inputs_key(new, frame) for frame in sorted(FRAMES)]
    assert _files(context) == kept
    assert http.get(f"/jobs/{old}").status_code == 404


def test_a_thorough_sweep_forgets_cameras_that_nobody_uses(sweep: Sweep, context: Context) -> None:
    with context.engine.begin() as connection:
        camera = cameras.add(connection, "ptp+ip://10.0.0.7")
    left = []
    for thorough in (False, True):
        sweep.run(thorough)
        with context.engine.connect() as connection:
            left.append(cameras.address_of(connection, camera))
    assert left == ["ptp+ip://10.0.0.7", None]


@pytest.mark.parametrize(
    ("delivery", "stays"),
    [(None, True), ("pending", True), ("delivered", False), ("failed", False)],
)
def test_a_job_whose_webhook_is_to_be_told_stays_until_it_is(
    delivery: str | None, stays: bool, sweep: Sweep, context: Context, finish: Finish
) -> None:
    job_id = stored_job(context, webhook={"url": "https://example.org", "secret": "s"})
    finish(job_id, {"manifest.json": b"{}"})
    ended = rows_of(context)[0].finished
    assert ended is not None
    with context.engine.begin() as connection:
        this = tables.jobs.c.id == job_id
        began = {"finished": ended - 60, "expires": ended - 30}  # kept for half a minute
        connection.execute(sa.update(tables.jobs).where(this).values(**began))
        if delivery:
            deliveries.write(connection, job_id, {"state": delivery, "attempts": 1})
    sweep.run(thorough=False)
    assert [job.id for job in rows_of(context)] == ([job_id] if stays else [])


def test_a_deleted_job_is_removed_though_its_webhook_is_not_told(
    sweep: Sweep, context: Context, http: httpx.Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    job_id = stored_job(context, webhook={"url": "https://example.org", "secret": "s"})
    with context.engine.begin() as connection:
        running = attempts.claim(connection, job_id, "a worker")
    assert running is not None
    with monkeypatch.context() as dying:  # the API, before anything is removed
        dying.setattr("service.api.jobs.remove", lambda *_arguments: None)
        assert http.delete(f"/jobs/{job_id}").status_code == 204
    with context.engine.begin() as connection:
        assert attempts.acknowledge_cancel(connection, running, 2 * 86400)
    sweep.run(thorough=False)
    assert rows_of(context) == []


def test_jobs_that_were_kept_for_ever_go_by_a_setting_that_came_later(
    sweep: Sweep, finished: Callable[[], str], context: Context
) -> None:
    job_id = finished()
    _expires(context, job_id, None)
    sweep.run(thorough=False)
    (job,) = rows_of(context)
    assert job.finished is not None and job.expires == pytest.approx(job.finished + 2 * 86400)


def test_without_the_setting_jobs_stay(
    context: Context, finished: Callable[[], str], settings: Settings
) -> None:
    finished()
    endless = settings.model_copy(update={"retention_days": None})
    Sweep(context.engine, context.storage, context.queue, endless).run(thorough=True)
    (job,) = rows_of(context)
    assert (job.state, job.expires) == (State.SUCCEEDED, None)
    assert len(_files(context)) == 3


@pytest.mark.parametrize("killed", ["before its files are gone", "before its row is gone"])
def test_a_removal_that_was_cut_short_is_finished(
    killed: str,
    sweep: Sweep,
    finished: Callable[[], str],
    context: Context,
    http: httpx.Client,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    job_id = finished()
    _expires(context, job_id, 1.0)

    def die(*_arguments: object) -> None:
        raise SystemExit

    with monkeypatch.context() as dying:
        if killed == "before its files are gone":
            dying.setattr(FolderStorage, "delete_below", die)
        else:
            dying.setattr(expiry, "remove", die)
        with pytest.raises(SystemExit):
            sweep.run(thorough=False)
    assert [job.state for job in rows_of(context)] == [State.EXPIRED]
    for path in ("results", "results.zip", "results/manifest.json"):
        assert http.get(f"/jobs/{job_id}/{path}").status_code == 410
    sweep.run(thorough=False)
    assert rows_of(context) == []
    assert _files(context) == []


@pytest.fixture
def locked(monkeypatch: pytest.MonkeyPatch) -> set[str]:
    """Keys, or what they begin with, that the store does not delete."""
    keys: set[str] = set()
    delete = Storage.delete

    def refuse(storage: Storage, key: str) -> None:
        if key.startswith(tuple(keys)):
            raise GenericError("Permission denied (os error 13)")
        delete(storage, key)

    monkeypatch.setattr(Storage, "delete", refuse)
    return keys


@pytest.mark.parametrize("batch", [1, 500])
def test_a_job_whose_files_cannot_be_deleted_keeps_nothing_else(
    batch: int,
    sweep: Sweep,
    finished: Callable[[], str],
    context: Context,
    locked: set[str],
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    monkeypatch.setattr("service.retention._BATCH", batch)
    due = [finished() for _ in range(4)]
    for number, job_id in enumerate(due):
        _expires(context, job_id, 1.0 + number)
    with context.engine.begin() as connection:
        uploads.add(connection, {"id": "over", "owner": "", "length": 9}, -3601.0)
    for key in ("jobs/stray/inputs/flash", "jobs/z/inputs/flash", "uploads/a/0", "uploads/over/0"):
        context.storage.put(key, b"light")
    jobs_folder = context.settings.data_dir / "store" / "jobs"
    for name in ("stray", "z"):
        for path in (jobs_folder / name, *(jobs_folder / name).rglob("*")):
            os.utime(path, (time.time() - 90_000,) * 2)
    locked.update({f"jobs/{due[0]}/", f"jobs/{due[1]}/", "jobs/stray/", "uploads/a/"})
    sweep.run(thorough=True)
    assert {job.id: job.state for job in rows_of(context)} == dict.fromkeys(due[:2], State.EXPIRED)
    assert set(context.storage.folders("jobs/")) == {*due[:2], "stray"}
    assert context.storage.list("uploads/") == ["uploads/a/0"]
    with context.engine.connect() as connection:
        assert uploads.find(connection, "", "over") is None
    told = [record for record in caplog.records if record.levelname == "WARNING"]
    assert [getattr(record, "job", None) for record in told].count(due[0]) == 1
    assert not any("manifest" in record.getMessage() for record in told)
    locked.clear()
    sweep.run(thorough=False)
    assert rows_of(context) == []


def test_room_is_made_by_what_comes_after_files_that_cannot_be_deleted(
    sweep: Sweep,
    finished: Callable[[], str],
    context: Context,
    locked: set[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("service.retention._BATCH", 1)
    stuck, other = sorted((finished(), finished()))
    for job_id in (stuck, other):
        _expires(context, job_id, 1.0)
    locked.add(f"jobs/{stuck}/")
    sweep.make_room()
    assert context.storage.folders("jobs/") == [stuck]


def test_a_sweep_ends_where_the_store_is_away(
    sweep: Sweep,
    finished: Callable[[], str],
    context: Context,
    locked: set[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for _ in range(2):
        _expires(context, finished(), 1.0)
    locked.add("jobs/")

    def away(_storage: Storage) -> None:
        raise GenericError("away")

    monkeypatch.setattr(Storage, "check", away)
    with pytest.raises(GenericError, match="away"):
        sweep.run(thorough=False)
    assert len(rows_of(context)) == 2


@pytest.mark.parametrize("state", ["queued", "running", "succeeded"])
def test_a_delete_that_was_cut_short_is_finished(
    state: str,
    sweep: Sweep,
    http: httpx.Client,
    finish: Finish,
    context: Context,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    job_id = stored_job(context)
    held = None
    if state == "running":
        with context.engine.begin() as connection:
            heartbeats.beat(connection, "w")
            held = attempts.claim(connection, job_id, "w")
    if state == "succeeded":
        finish(job_id, {"manifest.json": b"{}"})

    def die(*_arguments: object) -> None:
        raise GenericError("killed")

    with monkeypatch.context() as dying:
        dying.setattr(FolderStorage, "delete_below", die)
        assert http.delete(f"/jobs/{job_id}").status_code == 503
    if held:  # not before its worker lets it go
        sweep.run(thorough=False)
        assert [job.state for job in rows_of(context)] == [State.CANCELING]
        with context.engine.begin() as connection:
            assert attempts.acknowledge_cancel(connection, held, 1000)
    sweep.run(thorough=False)
    assert rows_of(context) == []
    assert _files(context) == []


def test_on_a_full_disk_files_that_are_due_make_room_for_what_is_written(
    sweep: Sweep, finished: Callable[[], str], context: Context, http: httpx.Client
) -> None:
    old, new = finished(), finished()
    waiting = stored_job(context)
    for job_id, seconds in ((old, -1), (new, 60), (waiting, -1)):
        _expires(context, job_id, time.time() + seconds)
    with context.engine.begin() as connection:
        uploads.add(connection, {"id": "over", "owner": "", "length": 9}, -3601.0)
    context.storage.put("uploads/over/0", b"light")
    with full_disk(context.engine):
        with pytest.raises(sa.exc.OperationalError):
            sweep.run(thorough=True)
        assert len(_files(context)) == 3 + 3 + 2 + 1
        with pytest.raises(sa.exc.OperationalError):  # the upload's row, once its piece is gone
            sweep.make_room()
    left = {key.rpartition("/")[0] for key in _files(context)}
    assert left == {f"jobs/{new}/1", f"jobs/{new}/inputs", f"jobs/{waiting}/inputs"}
    assert {job.id for job in rows_of(context)} == {old, new, waiting}
    for path in ("results", "results.zip", "results/manifest.json"):
        assert http.get(f"/jobs/{old}/{path}").status_code == 410
    assert http.post(f"/jobs/{old}/rerun").status_code == 410
    sweep.run(thorough=True)
    assert {job.id for job in rows_of(context)} == {new, waiting}
    with context.engine.connect() as connection:
        assert uploads.find(connection, "", "over") is None


def test_room_is_made_of_what_a_removal_that_was_cut_short_has_left(
    sweep: Sweep, finished: Callable[[], str], context: Context
) -> None:
    job_id = finished()
    _expires(context, job_id, 1.0)
    with context.engine.begin() as connection:
        assert expiry.expire(connection, 1) == [job_id]
    with full_disk(context.engine):
        sweep.make_room()
    assert _files(context) == []


@pytest.mark.parametrize("delivery", [None, "pending"])
def test_a_full_disk_takes_no_files_of_a_job_whose_webhook_is_to_be_told(
    delivery: str | None, sweep: Sweep, context: Context, finish: Finish
) -> None:
    job_id = stored_job(context, webhook={"url": "https://example.org", "secret": "s"})
    finish(job_id, {"manifest.json": b"{}"})
    _expires(context, job_id, time.time() - 1)
    with context.engine.begin() as connection:
        this = tables.jobs.c.id == job_id
        connection.execute(sa.update(tables.jobs).where(this).values(finished=1.0))
        if delivery:
            deliveries.write(connection, job_id, {"state": delivery, "attempts": 1})
    sweep.make_room()
    assert len(_files(context)) == 3


def test_a_heartbeat_makes_room_by_a_batch_of_jobs(
    sweep: Sweep, finished: Callable[[], str], context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("service.retention._BATCH", 1)
    for job_id in (finished(), finished()):
        _expires(context, job_id, 1.0)
    sweep.make_room()
    assert len(_files(context)) == 3
    sweep.make_room()
    assert _files(context) == []


def test_a_store_elsewhere_has_no_room_to_make(
    sweep: Sweep, finished: Callable[[], str], context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    _expires(context, finished(), 1.0)
    monkeypatch.setattr(FolderStorage, "free_bytes", lambda _storage: None)
    sweep.make_room()
    assert len(_files(context)) == 3


def test_room_is_made_of_old_files_without_a_job(sweep: Sweep, context: Context) -> None:
    for name in ("old", "young"):
        context.storage.put(f"jobs/{name}/inputs/flash", b"light")
    folder = context.settings.data_dir / "store" / "jobs" / "old"
    for path in (folder, *folder.rglob("*")):
        os.utime(path, (time.time() - 90_000,) * 2)
    sweep.make_room()
    assert _files(context) == ["jobs/young/inputs/flash"]


def test_old_files_without_a_job_go(
    sweep: Sweep, finished: Callable[[], str], context: Context
) -> None:
    job_id = finished()
    for name in ("old", "young"):
        context.storage.put(f"jobs/{name}/inputs/flash", b"light")
        context.storage.put(f"jobs/{name}/inputs/no_flash", b"light")
    store = context.settings.data_dir / "store" / "jobs"
    for folder in (store / "old", store / job_id):
        for path in (folder, *folder.rglob("*")):
            os.utime(path, (time.time() - 90_000,) * 2)
    os.utime(store / "young" / "inputs" / "flash", (time.time() - 90_000,) * 2)
    sweep.run(thorough=False)
    assert set(context.storage.folders("jobs/")) == {job_id, "old", "young"}
    sweep.run(thorough=True)
    assert set(context.storage.folders("jobs/")) == {job_id, "young"}
    assert len(context.storage.list(f"jobs/{job_id}/")) == 3


@pytest.mark.parametrize("name", ["inputs", "inputs/no_flash#1"])
def test_files_that_are_being_stored_stay(name: str, sweep: Sweep, context: Context) -> None:
    begun = context.settings.data_dir / "store" / "jobs" / "new" / name
    begun.parent.mkdir(parents=True)
    if name == "inputs":
        begun.mkdir()
    else:
        begun.write_bytes(b"half")
        for folder in (begun.parent, begun.parent.parent):
            os.utime(folder, (time.time() - 90_000,) * 2)
    assert context.storage.folders("jobs/") == ["new"]
    assert context.storage.list("jobs/") == []
    sweep.run(thorough=True)
    assert begun.exists()


def test_uploads_whose_time_is_over_go(sweep: Sweep, context: Context) -> None:
    with context.engine.begin() as connection:
        for upload_id, seconds in (("over", -3601.0), ("under-way", 3600.0)):
            uploads.add(connection, {"id": upload_id, "owner": "", "length": 9}, seconds)
    for upload_id in ("over", "under-way", "of-nobody"):
        context.storage.put(f"uploads/{upload_id}/0", b"light")
    sweep.run(thorough=False)
    assert len(context.storage.list("uploads/")) == 3
    sweep.run(thorough=True)
    assert context.storage.list("uploads/") == ["uploads/under-way/0"]
    with context.engine.connect() as connection:
        assert uploads.find(connection, "", "over") is None
        assert uploads.find(connection, "", "under-way") is not None


def test_files_without_a_row_stay_in_the_store_of_another_database(
    sweep: Sweep,
    finished: Callable[[], str],
    context: Context,
    caplog: pytest.LogCaptureFixture,
) -> None:
    due = finished()
    _expires(context, due, time.time() - 1)
    for key in ("jobs/old/inputs/flash", "uploads/anothers/000-x"):
        context.storage.put(key, b"light")
    folder = context.settings.data_dir / "store" / "jobs" / "old"
    for path in (folder, *folder.rglob("*")):
        os.utime(path, (time.time() - 90_000,) * 2)
    context.storage.put("database-id", b"another")
    sweep.run(thorough=True)
    sweep.make_room()
    assert _files(context) == ["jobs/old/inputs/flash", "uploads/anothers/000-x"]
    assert rows_of(context) == []  # what is due goes as ever
    assert "the store has files of another database" in caplog.text
    context.storage.put("database-id", belonging.id_of(context.engine).encode() + b"\n")
    sweep.run(thorough=True)
    assert _files(context) == []

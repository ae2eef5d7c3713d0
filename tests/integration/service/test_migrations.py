"""From every released schema to this program's, on both databases."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa
from alembic import command
from alembic.autogenerate import compare_metadata
from alembic.config import Config
from alembic.migration import MigrationContext

from service import belonging, migrations
from service.cli import run
from service.dbos_queue.queue import Queue, migrate
from service.errors import StoredQuotaError
from service.rows import clock, database, expiry, jobs, quotas, tables, waiting
from service.rows.states import State
from tests.plans import plans

_OLD_STATES = ("queued", "running", "canceling", "succeeded", "failed", "canceled")


@pytest.fixture(params=["sqlite", "postgresql"])
def url(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[str]:
    """An empty database."""
    if request.param == "sqlite":
        yield f"sqlite:///{tmp_path / 'jobs.sqlite'}"
        return
    server = request.getfixturevalue("postgresql")
    root = sa.create_engine(
        server.replace("postgresql:", "postgresql+psycopg:"), isolation_level="AUTOCOMMIT"
    )
    with root.connect() as connection:
        connection.exec_driver_sql("CREATE DATABASE migrated")
    yield f"{server.rpartition('/')[0]}/migrated"
    with root.connect() as connection:
        connection.exec_driver_sql("DROP DATABASE migrated WITH (FORCE)")
    root.dispose()


@pytest.fixture
def empty(url: str) -> Iterator[sa.Engine]:
    connected = database.connect(url)
    yield connected
    connected.dispose()


def _make_first(empty: sa.Engine) -> None:
    """The tables as the first version made them, which wrote no number down."""
    migrations.upgrade(empty, "0001")
    with empty.begin() as connection:
        connection.exec_driver_sql("DROP TABLE alembic_version")


def _add_old_jobs(connection: sa.Connection) -> None:
    for number, state in enumerate(_OLD_STATES):
        held = state in ("running", "canceling")
        connection.execute(
            sa.text(
                "INSERT INTO jobs (id, state, fraction, attempt, lost, worker, options, inputs, "
                "results, trace_id, idempotency_key, request_hash, created) VALUES (:id, :state, "
                "0.5, 1, 0, :worker, :options, :inputs, :results, :trace, :key, 'hash', :created)"
            ),
            {
                "id": state,
                "state": state,
                "worker": "w" if held else None,
                "options": '{"lights": 2}',
                "inputs": '{"flash": {"key": "k", "sha256": "s"}}',
                "results": '[{"name": "a"}]' if state == "succeeded" else None,
                "trace": "1" * 32,
                "key": f"key of {state}",
                "created": 1000.0 + number,
            },
        )


@pytest.mark.parametrize("url", ["postgresql"], indirect=True)
def test_a_loaded_host_has_a_minute_between_statements_while_it_migrates(
    empty: sa.Engine, monkeypatch: pytest.MonkeyPatch
) -> None:
    """PostgreSQL ends other transactions that pause for five seconds."""
    asked, steps = "SHOW idle_in_transaction_session_timeout", command.upgrade
    meanwhile: list[str] = []

    def upgrade(config: Config, target: str) -> None:
        meanwhile.append(config.attributes["connection"].exec_driver_sql(asked).scalar_one())
        steps(config, target)

    monkeypatch.setattr(command, "upgrade", upgrade)
    migrations.upgrade(empty)
    with empty.connect() as connection:
        assert (meanwhile, connection.exec_driver_sql(asked).scalar_one()) == (["1min"], "5s")


def test_the_steps_lead_to_the_tables_of_this_program(empty: sa.Engine) -> None:
    assert migrations.upgrade(empty) == (None, migrations.newest())
    with empty.connect() as connection:
        context = MigrationContext.configure(connection, opts={"compare_type": True})
        assert compare_metadata(context, tables.metadata) == []


def test_calibrations_are_found_by_their_index(empty: sa.Engine) -> None:
    migrations.upgrade(empty)
    row = {"options": {}, "state": "succeeded", "trace_id": "1", "request_hash": "", "created": 1.0}
    with empty.begin() as connection:
        many = [{"id": str(number), "likeness": "best-best", **row} for number in range(1000)]
        kept = {"id": "kept", "likeness": "calibrate-flash", **row, "options": {"setup": "default"}}
        connection.execute(sa.insert(tables.jobs), [*many, kept])
        connection.exec_driver_sql("ANALYZE")
    with empty.connect() as connection, plans(empty) as found:
        assert [job.id for job in jobs.kept_calibrations(connection, "", "default")] == ["kept"]
    assert ["jobs_that_calibrate" in plan for plan in found] == [True]


def test_waiting_jobs_and_bytes_are_found_by_indexes(empty: sa.Engine) -> None:
    migrations.upgrade(empty)
    row = {"options": {"": "x" * 1000}, "trace_id": "1", "request_hash": "", "created": 1.0}
    key = {"id": "a", "digest": "", "name": "", "scopes": [], "created": 1.0, "stored_bytes": 199}
    with empty.begin() as connection:
        connection.execute(sa.insert(tables.keys), key)
        for owner, count in (("", 1900), ("a", 100)):
            done = {"owner": owner, "state": "succeeded", "stored_bytes": 2, **row}
            many = [{"id": f"{owner}{number}", **done} for number in range(count)]
            connection.execute(sa.insert(tables.jobs), many)
        for job_id in ("first", "second"):
            jobs.add(connection, {**_values(job_id), "deadline": 1.0})
    with empty.connect().execution_options(isolation_level="AUTOCOMMIT") as connection:
        connection.exec_driver_sql("VACUUM")
        connection.exec_driver_sql("ANALYZE")
    with empty.begin() as connection, plans(empty) as found:
        with pytest.raises(StoredQuotaError):
            quotas.check(connection, "a")
        shown = [job for job in [jobs.find(connection, "second")] if job]
        assert waiting.positions(connection, shown) == {"second": 2}
        assert [job_id for job_id, _ in waiting.overdue(connection, 1)] == ["first"]
    used = {word.strip(",()") for plan in found for word in plan.split() if "jobs_by" in word}
    assert "jobs_by_bytes" in used
    assert not any("Seq Scan on jobs" in plan or "SCAN jobs" in plan for plan in found)


def test_what_the_older_program_writes_meanwhile_is_complete(empty: sa.Engine) -> None:
    migrations.upgrade(empty)
    with empty.begin() as connection:
        _add_old_jobs(connection)
        for column in tables.jobs.columns:
            if not column.nullable:
                found = connection.execute(
                    sa.select(sa.func.count()).select_from(tables.jobs).where(column.is_(None))
                )
                assert (column.name, found.scalar_one()) == (column.name, 0)


def test_jobs_of_the_first_version_go_forward(empty: sa.Engine) -> None:
    migrate(empty)
    _make_first(empty)
    queue = Queue(empty)
    with empty.begin() as connection:
        _add_old_jobs(connection)
        queue.submit(connection, "queued", 1)
    assert migrations.upgrade(empty) == ("0001", migrations.newest())
    with empty.connect() as connection:
        found = {state: jobs.find(connection, state) for state in _OLD_STATES}
        owned = jobs.find_by_key(connection, "", "key of failed")
    for number, (state, job) in enumerate(found.items()):
        assert job is not None
        assert (job.state, job.attempt, job.created) == (State(state), 1, 1000.0 + number)
        assert (job.options, job.trace_id) == ({"lights": 2}, "1" * 32)
        assert job.inputs == {"flash": {"key": "k", "sha256": "s"}}
        assert (job.owner, job.priority, job.rank, job.revision) == ("", "normal", 1, 1)
    assert found["succeeded"] and found["succeeded"].results == [{"name": "a"}]
    assert found["running"] and found["running"].worker == "w"
    assert owned == found["failed"]
    with empty.begin() as connection:  # the queue has what it had, and may be written
        assert _in_queue(connection) == ["queued"]
        rank = jobs.add(connection, {**_values("new"), "idempotency_key": "new"})
        queue.submit(connection, "new", rank)
    with empty.connect() as connection:
        assert _in_queue(connection) == ["new", "queued"]
    with pytest.raises(sa.exc.IntegrityError), empty.begin() as connection:
        jobs.add(connection, {**_values("other"), "idempotency_key": "new"})
    queue.close()


def _values(job_id: str) -> dict[str, Any]:
    return {"id": job_id, "options": {}, "trace_id": "1" * 32, "request_hash": ""}


def _in_queue(connection: sa.Connection) -> list[str]:
    schema = "dbos." if connection.dialect.name == "postgresql" else ""
    found = connection.exec_driver_sql(
        f"SELECT workflow_uuid FROM {schema}workflow_status WHERE status = 'ENQUEUED'"
    )
    return sorted(found.scalars())


def test_rows_that_refer_to_jobs_stay_when_the_table_is_made_anew(empty: sa.Engine) -> None:
    _make_first(empty)
    with empty.begin() as connection:
        _add_old_jobs(connection)
        connection.exec_driver_sql(
            "CREATE TABLE notes (job VARCHAR(32) REFERENCES jobs (id) ON DELETE CASCADE)"
        )
        connection.exec_driver_sql("INSERT INTO notes VALUES ('queued')")
    migrations.upgrade(empty)
    with empty.begin() as connection:
        assert connection.exec_driver_sql("SELECT job FROM notes").scalars().all() == ["queued"]
        expiry.remove(connection, "queued")
        assert connection.exec_driver_sql("SELECT job FROM notes").scalars().all() == []


def test_of_processes_that_migrate_at_once_one_does(url: str, empty: sa.Engine) -> None:
    _make_first(empty)
    with empty.begin() as connection:
        _add_old_jobs(connection)

    def migrate(_number: int) -> str | None:
        connected = database.connect(url)
        try:
            return migrations.upgrade(connected)[0]
        finally:
            connected.dispose()

    with ThreadPoolExecutor(4) as pool:
        before = list(pool.map(migrate, range(4)))
    assert sorted(map(str, before)) == ["0001", *[migrations.newest()] * 3]
    with empty.connect() as connection:
        assert len(jobs.page(connection, "", 100, None)) == len(_OLD_STATES)


def test_a_step_that_fails_leaves_everything_as_it_was(empty: sa.Engine) -> None:
    _make_first(empty)
    with empty.begin() as connection:
        connection.exec_driver_sql("DROP INDEX jobs_by_age")
    with pytest.raises(sa.exc.DBAPIError):
        migrations.upgrade(empty)
    columns = {column["name"] for column in sa.inspect(empty).get_columns("jobs")}
    assert "owner" not in columns
    assert not sa.inspect(empty).has_table("alembic_version")


@pytest.fixture
def settings(url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The database and a folder of the test's own, as variables."""
    monkeypatch.setenv("LIGHTLAYERS_DATABASE_URL", url)
    monkeypatch.setenv("LIGHTLAYERS_DATA_DIR", str(tmp_path))
    monkeypatch.setenv("LIGHTLAYERS_PORT", "0")


def test_an_older_database_is_named_once(empty: sa.Engine) -> None:
    migrations.upgrade(empty, "0006")
    with empty.begin() as connection:
        _add_old_jobs(connection)
        started = connection.execute(sa.select(clock.now())).scalar_one()
    migrations.upgrade(empty)
    with empty.connect() as connection:
        row = connection.execute(sa.select(tables.identity)).one()
    assert len(row.id) == 32 and started <= row.created < started + 60
    migrations.upgrade(empty)
    assert belonging.id_of(empty) == row.id


@pytest.mark.usefixtures("settings")
def test_the_command_says_where_it_has_come_to(
    empty: sa.Engine, capsys: pytest.CaptureFixture[str]
) -> None:
    newest = migrations.newest()
    assert run(["migrate"]) == 0
    assert capsys.readouterr().out == f"The database is at schema {newest}, from nothing.\n"
    assert run(["migrate"]) == 0
    assert "it was there already" in capsys.readouterr().out
    assert migrations.check(empty) == newest


@pytest.mark.usefixtures("settings")
@pytest.mark.parametrize("command", ["serve", "worker", "migrate"])
def test_a_newer_database_is_refused(
    command: str, empty: sa.Engine, capsys: pytest.CaptureFixture[str]
) -> None:
    migrations.upgrade(empty)
    with empty.begin() as connection:
        connection.exec_driver_sql("UPDATE alembic_version SET version_num = '9999'")
    assert run([command]) == 2
    assert "schema 9999, which this lightlayers does not know" in capsys.readouterr().err


@pytest.mark.usefixtures("settings")
@pytest.mark.parametrize("url", ["postgresql"], indirect=True)
@pytest.mark.parametrize("command", ["serve", "worker"])
@pytest.mark.parametrize("old", [False, True])
def test_a_shared_database_is_never_migrated_in_passing(
    command: str, old: bool, empty: sa.Engine, capsys: pytest.CaptureFixture[str]
) -> None:
    if old:
        _make_first(empty)
    assert run([command]) == 2
    assert "run `lightlayers migrate`" in capsys.readouterr().err
    columns = sa.inspect(empty).get_columns("jobs") if old else []
    assert "owner" not in [column["name"] for column in columns]


@pytest.mark.usefixtures("settings")
def test_a_table_of_somebody_elses_is_left_alone(
    empty: sa.Engine, capsys: pytest.CaptureFixture[str]
) -> None:
    with empty.begin() as connection:
        connection.exec_driver_sql("CREATE TABLE jobs (id INTEGER, what VARCHAR(10))")
    assert run(["migrate"]) == 2
    assert "that no released lightlayers made" in capsys.readouterr().err

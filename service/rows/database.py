"""The database of jobs and workers, shared with the queue: SQLite or PostgreSQL."""

from __future__ import annotations

import sqlite3
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import sqlalchemy as sa
from sqlalchemy.ext.compiler import compiles
from sqlalchemy.sql.functions import FunctionElement

metadata = sa.MetaData()
"""Where the steps of service.migrations lead."""

_PATIENCE_SECONDS = 30  # with SQLite that others write to

IN_MEMORY = (None, "", ":memory:")
"""Names of SQLite's databases that are in no file."""

AWAY = (
    sa.exc.OperationalError,
    sa.exc.InterfaceError,
    sa.exc.InternalError,
    sa.exc.TimeoutError,
)
"""What is raised while a database is away or has no room, has dropped a connection, or all
connections to it are in use."""

_CALLS = "once committed"

_DISK_FULL = "53100"  # PostgreSQL's code
# The second, "disk I/O error" in words, is of the file beside it that whoever opens it needs.
_SQLITE_FULL = (sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR_SHMSIZE)

_POSTGRESQL = {
    # A host that is cut off is noticed, whichever of the two has something to say.
    "connect_timeout": 5,
    "keepalives_idle": 5,
    "keepalives_interval": 2,
    "keepalives_count": 3,
    "tcp_user_timeout": 10_000,
    # A process that is frozen in mid-transaction must not keep rows from everybody else.
    "options": "-c idle_in_transaction_session_timeout=5000",
}


class now(FunctionElement[float]):  # noqa: N801  reads as the SQL function it is
    """The database's clock, in seconds since 1970, so that no host's clock matters."""

    type = sa.Double()
    inherit_cache = True
    name = "now"


@compiles(now, "sqlite")
def _sqlite_now(_element: now, _compiler: Any, **_options: Any) -> str:
    return "((julianday('now') - 2440587.5) * 86400.0)"


@compiles(now, "postgresql")
def _postgresql_now(_element: now, _compiler: Any, **_options: Any) -> str:
    return "CAST(EXTRACT(EPOCH FROM clock_timestamp()) AS DOUBLE PRECISION)"


def moment() -> sa.ScalarSelect[float]:
    """The same clock as one value, which PostgreSQL looks up in an index."""
    return sa.select(now()).scalar_subquery()


jobs = sa.Table(
    "jobs",
    metadata,
    sa.Column("id", sa.String(32), primary_key=True),
    # Counts the writes of the row, so that who watches it knows whether it has changed.
    sa.Column("revision", sa.Integer, nullable=False, default=1),
    sa.Column("owner", sa.String(32), nullable=False, default=""),  # id of a key; "" without keys
    sa.Column("state", sa.String(24), nullable=False),
    # Jobs wait in the order of their ranks; see service.rows.fairness.
    sa.Column("priority", sa.String(8), nullable=False, default="normal"),
    sa.Column("rank", sa.Integer, nullable=False, default=1),
    sa.Column("stage", sa.String(16)),
    sa.Column("fraction", sa.Double, nullable=False, default=0.0),
    # How much of the whole attempt is done, and when it is likely to end: service.rows.eta.
    sa.Column("progress", sa.Double, nullable=False, default=0.0),
    sa.Column("eta", sa.Double),
    sa.Column("likeness", sa.String(64), nullable=False, default=""),
    sa.Column("stage_seconds", sa.JSON(none_as_null=True)),
    # Attempts are numbered from 1; `attempt` is the last one started and the only one that may
    # write. `lost` counts those whose worker died under them.
    sa.Column("attempt", sa.Integer, nullable=False, default=0),
    sa.Column("lost", sa.Integer, nullable=False, default=0),
    sa.Column("worker", sa.String(64)),
    sa.Column("options", sa.JSON, nullable=False),
    sa.Column("capture", sa.JSON(none_as_null=True)),
    sa.Column("camera", sa.String(16)),  # id of the one that takes the pair: service.rows.cameras
    # What it was set to for the pair, by name.
    sa.Column("camera_settings", sa.JSON(none_as_null=True)),
    sa.Column("inputs", sa.JSON(none_as_null=True)),
    sa.Column("results", sa.JSON(none_as_null=True)),
    sa.Column("error", sa.JSON(none_as_null=True)),
    sa.Column("trace_id", sa.String(32), nullable=False),
    sa.Column("span_id", sa.String(16)),  # of the request in the trace, where traces are made
    # What a person is asked to do, the number of the request, and until when it waits.
    sa.Column("request", sa.String(200)),
    sa.Column("requests", sa.Integer, nullable=False, default=0),
    sa.Column("request_until", sa.Double),
    sa.Column("webhook", sa.JSON(none_as_null=True)),
    # How far the delivery to the webhook is; null until its first attempt is queued.
    sa.Column("delivery", sa.JSON(none_as_null=True)),
    sa.Column("idempotency_key", sa.String(255)),
    sa.Column("request_hash", sa.String(64), nullable=False),
    sa.Column("created", sa.Double, nullable=False),
    sa.Column("started", sa.Double),
    sa.Column("finished", sa.Double),
    sa.Column("deadline", sa.Double),  # fails when it has not ended by then
    sa.Column("expires", sa.Double),  # is removed then
    sa.Column("stored_bytes", sa.BigInteger, nullable=False, default=0),  # photographs and results
    sa.UniqueConstraint("owner", "idempotency_key", name="jobs_by_idempotency_key"),
    sa.Index("jobs_by_age", "owner", "created", "id"),
    sa.Index("jobs_by_time", "created", "id"),  # those of all owners
    sa.Index("jobs_by_bytes", "owner", "stored_bytes"),  # added up without a look at the rows
    # Whatever looks at waiting or ended jobs reads as much of an index as it finds, and no more.
    sa.Index("jobs_by_state", "state", "created", "id"),
    sa.Index("jobs_by_rank", "state", "rank", "created", "id"),
    sa.Index("jobs_by_flow", "state", "owner", "priority", "rank"),
    sa.Index("jobs_by_deadline", "state", "deadline"),
    sa.Index("jobs_by_expiry", "state", "expires"),
    sa.Index("jobs_by_likeness", "likeness", "state", "created"),
    sa.Index("jobs_by_camera", "camera", "state"),
)

# Few rows at any time, so that workers may look often: a job leaves it when its delivery begins.
sa.Index(
    "jobs_with_news",
    jobs.c.finished,
    sqlite_where=jobs.c.webhook.is_not(None) & jobs.c.delivery.is_(None),
    postgresql_where=jobs.c.webhook.is_not(None) & jobs.c.delivery.is_(None),
)

CALIBRATES = jobs.c.likeness.like(sa.literal_column("'calibrate-%'"))
"""Whether a job is a calibration. Spelt out, with no parameter, it is found by its index."""

# Few rows beside an owner's separations, each of which may look for calibrations.
# By the state, too: SQLite, which counts nothing, would take jobs_by_age for as good.
sa.Index(
    "jobs_that_calibrate",
    jobs.c.owner,
    jobs.c.state,
    jobs.c.created,
    sqlite_where=CALIBRATES,
    postgresql_where=CALIBRATES,
)

# Cameras that somebody has asked for, as they were when they last answered.
cameras = sa.Table(
    "cameras",
    metadata,
    sa.Column("id", sa.String(16), primary_key=True),
    sa.Column("address", sa.String(300), nullable=False),
    sa.Column("make", sa.String(255), nullable=False, default=""),
    sa.Column("model", sa.String(255), nullable=False, default=""),
    sa.Column("serial", sa.String(255), nullable=False, default=""),
    sa.Column("battery_percent", sa.Integer),
    sa.Column("free_bytes", sa.BigInteger),
    sa.Column("answered", sa.Boolean, nullable=False, default=False),  # when last looked at
    sa.Column("looked", sa.Double, nullable=False, default=0.0),
    # Until then at most somebody looks at it or sets it, and no job may begin to use it.
    sa.Column("taken_until", sa.Double, nullable=False, default=0.0),
    # On whose USB it was last seen, where a worker can use it: service.workers.host.
    sa.Column("host", sa.String(32)),
)

workers = sa.Table(
    "workers",
    metadata,
    sa.Column("id", sa.String(64), primary_key=True),
    sa.Column("seen", sa.Double, nullable=False),
)

keys = sa.Table(
    "keys",
    metadata,
    sa.Column("id", sa.String(16), primary_key=True),  # a part of the key; owner of its jobs
    sa.Column("digest", sa.String(64), nullable=False),  # SHA-256 of the key, hexadecimal
    sa.Column("name", sa.String(100), nullable=False),
    sa.Column("scopes", sa.JSON, nullable=False),
    # Quotas; null where there is none.
    sa.Column("waiting_jobs", sa.Integer),
    sa.Column("jobs_per_day", sa.Integer),
    sa.Column("stored_bytes", sa.BigInteger),
    # Jobs made on `day`, which counts from 1970, in UTC.
    sa.Column("day", sa.Integer, nullable=False, default=0),
    sa.Column("jobs_of_day", sa.Integer, nullable=False, default=0),
    sa.Column("created", sa.Double, nullable=False),
    sa.Column("expires", sa.Double),
    sa.Column("revoked", sa.Double),
    sa.Column("used", sa.Double),  # to the hour, so that requests do not write
)

# One row: which database this is, and since when it has a name; its store has the id, too.
identity = sa.Table(
    "identity",
    metadata,
    sa.Column("id", sa.String(32), primary_key=True),
    sa.Column("created", sa.Double, nullable=False),
)

# Photographs that come piece by piece (tus), until a job takes them over.
uploads = sa.Table(
    "uploads",
    metadata,
    sa.Column("id", sa.String(32), primary_key=True),
    sa.Column("owner", sa.String(32), nullable=False, default=""),
    sa.Column("length", sa.BigInteger, nullable=False),
    sa.Column("received", sa.BigInteger, nullable=False, default=0),
    sa.Column("parts", sa.JSON, nullable=False),  # names of the objects that hold it, in order
    sa.Column("metadata", sa.Text),  # as the client sent it
    sa.Column("expires", sa.Double, nullable=False),
    sa.Index("uploads_by_expiry", "expires"),
)


def connect(url: str) -> sa.Engine:
    """Open an engine for our tables and the queue's, whose connections know once_committed.

    What a statement was sent with, secrets of webhooks among it, is in no error's text. On SQLite
    every writing transaction takes the lock when it begins to write, and waits for it. Raises
    ValueError or sqlalchemy's ArgumentError for an address that is none of either database.
    """
    parsed = sa.make_url(url)
    if "@" in (parsed.host or ""):
        raise ValueError("The host has a part of the password, which errors of its look-up tell.")
    if parsed.get_backend_name() == "postgresql":
        here = parsed.set(drivername="postgresql+psycopg")
        arguments = {name: _POSTGRESQL[name] for name in _POSTGRESQL if name not in parsed.query}
        engine = sa.create_engine(
            here, pool_pre_ping=True, hide_parameters=True, connect_args=arguments
        )
        _watch_ends(engine)
        return engine
    if parsed.get_backend_name() != "sqlite":
        raise ValueError("The address is neither of SQLite nor of PostgreSQL.")
    if parsed.database in IN_MEMORY:
        raise ValueError("A database in memory is no other process's, and ends with its own.")
    # Secrets of webhooks are in it; what is there already is its owner's to close.
    Path(str(parsed.database)).parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    engine = sa.create_engine(parsed, hide_parameters=True)
    _watch_ends(engine)

    @sa.event.listens_for(engine, "connect")
    def _configure(connection: Any, _record: object) -> None:
        connection.isolation_level = "IMMEDIATE"
        connection.execute(f"PRAGMA busy_timeout={_PATIENCE_SECONDS * 1000}")
        _switch_to_wal(connection)
        # What was committed outlasts a power cut: an accepted job is a promise.
        connection.execute("PRAGMA synchronous=FULL")
        connection.execute("PRAGMA foreign_keys=ON")

    return engine


def once_committed(connection: sa.Connection, call: Callable[[], None]) -> None:
    """Call something once this transaction is committed and its connection free, or never."""
    connection.info.setdefault(_CALLS, []).append(call)


def _watch_ends(engine: sa.Engine) -> None:
    """Make the calls of transactions that are committed, and forget those of others."""

    @sa.event.listens_for(engine, "rollback")
    def _forget(connection: sa.Connection) -> None:
        if not connection.invalidated:  # its calls went with what was connected
            connection.info.pop(_CALLS, None)

    @sa.event.listens_for(engine, "handle_error")
    def _forget_too(context: sa.engine.ExceptionContext) -> None:
        if context.connection is not None and context.statement is None:  # the commit failed
            _forget(context.connection)

    @sa.event.listens_for(engine, "checkin")
    def _make(_connection: object, record: sa.pool.ConnectionPoolEntry) -> None:
        calls = record.info.pop(_CALLS, ())
        if record.dbapi_connection is not None:
            for call in calls:
                call()


def may_be_id(text: str) -> bool:
    """Whether a row may have this id: what no database takes, like a NUL, is none, either."""
    return text.isascii() and text.isprintable()


def is_full(error: Exception) -> bool:
    """Whether an error is a statement's that failed because the database's disk has no room."""
    cause = getattr(error, "orig", None)
    return (
        getattr(cause, "sqlite_errorcode", None) in _SQLITE_FULL
        or getattr(cause, "sqlstate", None) == _DISK_FULL
    )


def _switch_to_wal(connection: Any) -> None:
    # The one statement that does not wait for a lock by itself.
    deadline = time.monotonic() + _PATIENCE_SECONDS
    while True:
        try:
            connection.execute("PRAGMA journal_mode=WAL")
            return
        except sqlite3.OperationalError as error:
            if error.sqlite_errorcode != sqlite3.SQLITE_BUSY or time.monotonic() > deadline:
                raise
            time.sleep(0.02)

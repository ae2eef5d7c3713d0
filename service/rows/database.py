"""Connections to the database, which the queue shares: SQLite or PostgreSQL."""

from __future__ import annotations

import sqlite3
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import sqlalchemy as sa

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


def connect(url: str) -> sa.Engine:
    """Open an engine for our tables and the queue's, whose connections know once_committed.

    What a statement was sent with, secrets of webhooks among it, is in no error's text. On SQLite
    every writing transaction takes the lock when it begins to write, and waits for it. Raises
    ValueError or sqlalchemy's ArgumentError for an address that is none of either database.
    """
    parsed = sa.make_url(url)
    if "@" in (parsed.host or ""):
        raise ValueError("The host has a part of the password, which errors of its look-up tell.")
    backend = parsed.get_backend_name()
    if backend not in ("postgresql", "sqlite"):
        raise ValueError("The address is neither of SQLite nor of PostgreSQL.")
    engine = _on_postgresql(parsed) if backend == "postgresql" else _on_sqlite(parsed)
    _watch_ends(engine)
    return engine


def _on_postgresql(url: sa.URL) -> sa.Engine:
    arguments = {name: _POSTGRESQL[name] for name in _POSTGRESQL if name not in url.query}
    return sa.create_engine(
        url.set(drivername="postgresql+psycopg"),
        pool_pre_ping=True,
        hide_parameters=True,
        connect_args=arguments,
    )


def _on_sqlite(url: sa.URL) -> sa.Engine:
    if url.database in IN_MEMORY:
        raise ValueError("A database in memory is no other process's, and ends with its own.")
    # Secrets of webhooks are in it; what is there already is its owner's to close.
    Path(str(url.database)).parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    engine = sa.create_engine(url, hide_parameters=True)

    @sa.event.listens_for(engine, "connect")
    def _configure(connection: Any, _record: object) -> None:
        connection.isolation_level = "IMMEDIATE"
        connection.execute(f"PRAGMA busy_timeout={_PATIENCE_SECONDS * 1000}")
        _switch_to_wal(connection)
        # What was committed outlasts a power cut: an accepted job is a promise.
        connection.execute("PRAGMA synchronous=FULL")
        connection.execute("PRAGMA foreign_keys=ON")

    return engine


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

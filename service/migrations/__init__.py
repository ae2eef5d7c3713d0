"""The schema of our tables, and the way to it from every schema that was ever released.

Forward only: each file of versions/ is one step, and service.rows.tables says where they lead. A
step adds, so that processes of the version before go on working until they are replaced: what may
not be null has a default in the database itself.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import sqlalchemy as sa
from alembic import command
from alembic.config import Config
from alembic.migration import MigrationContext
from alembic.script import ScriptDirectory

_LOCK = 0x11647  # any number that stays the same
_IDLE_MS = 60_000  # steps are loaded amid the transaction, which may take a loaded host seconds
_FIRST = "0001"
_FIRST_COLUMNS = 18
"""Of `jobs` in databases from before versions were written down."""


class SchemaError(Exception):
    """The database is at another schema than this program. The message is one sentence."""


def upgrade(engine: sa.Engine, target: str = "head") -> tuple[str | None, str]:
    """Bring our tables to a version; the versions before (None: no tables) and after.

    Safe to call from several processes at once: one works, the others find it done. All or nothing
    is done. Raises SchemaError for a database that is newer than this program.
    """
    with _alone(engine) as connection:
        before = _recognise(connection)
        config = _config()
        config.attributes["connection"] = connection
        if before == _FIRST and _written(connection) is None:
            command.stamp(config, _FIRST)
        command.upgrade(config, target)
        after = _written(connection)
    assert after is not None
    return before, after


def check(engine: sa.Engine) -> str:
    """Tell the version of the database, which must be that of this program. Raises SchemaError."""
    with engine.connect() as connection:
        found = _recognise(connection)
    if found is None:
        raise SchemaError("The database has no tables yet: run `lightlayers migrate`.")
    if found != newest():
        raise SchemaError(
            f"The database is at schema {found} and this lightlayers needs {newest()}: run "
            "`lightlayers migrate`; what is running meanwhile goes on."
        )
    return found


def newest() -> str:
    """Tell the version that this program needs."""
    head = ScriptDirectory.from_config(_config()).get_current_head()
    assert head is not None
    return head


def _config() -> Config:
    config = Config()
    # alembic takes % for the start of a variable
    config.set_main_option("script_location", str(Path(__file__).parent).replace("%", "%%"))
    return config


def _written(connection: sa.Connection) -> str | None:
    return MigrationContext.configure(connection).get_current_revision()


def _recognise(connection: sa.Connection) -> str | None:
    written = _written(connection)
    if written is not None:
        script = ScriptDirectory.from_config(_config())
        if written not in [step.revision for step in script.walk_revisions()]:
            raise SchemaError(
                f"The database is at schema {written}, which this lightlayers does not know: a "
                "newer one has migrated it, so run that one."
            )
        return written
    tables = sa.inspect(connection)
    if not tables.has_table("jobs"):
        return None
    if len(tables.get_columns("jobs")) != _FIRST_COLUMNS:
        raise SchemaError(
            "The database has a table `jobs` that no released lightlayers made: give an empty "
            "database, or that of a released one."
        )
    return _FIRST


@contextmanager
def _alone(engine: sa.Engine) -> Iterator[sa.Connection]:
    """Hold the one lock for migrations, in one transaction."""
    with engine.connect() as connection:
        if engine.dialect.name == "sqlite":
            # A table that is made anew must not take along the rows that refer to it.
            connection.exec_driver_sql("PRAGMA foreign_keys=OFF")
            connection.commit()
            connection.exec_driver_sql("BEGIN IMMEDIATE")
        else:
            connection.exec_driver_sql(
                f"SET LOCAL idle_in_transaction_session_timeout = {_IDLE_MS}"
            )
            connection.execute(sa.select(sa.func.pg_advisory_xact_lock(_LOCK)))
        try:
            yield connection
            connection.commit()
        finally:
            connection.rollback()
            if engine.dialect.name == "sqlite":
                connection.exec_driver_sql("PRAGMA foreign_keys=ON")

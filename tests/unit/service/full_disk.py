"""A database whose disk is full."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import Any

import psycopg
import sqlalchemy as sa


@contextlib.contextmanager
def full_disk(engine: sa.Engine) -> Iterator[None]:
    """Let statements of this engine that write fail for as long as the block."""

    def execute(_connection: Any, _cursor: Any, statement: str, *_arguments: Any) -> None:
        if statement.startswith(("INSERT", "UPDATE", "DELETE")):
            raise sa.exc.OperationalError(statement, None, psycopg.errors.DiskFull())

    sa.event.listen(engine, "before_cursor_execute", execute)
    try:
        yield
    finally:
        sa.event.remove(engine, "before_cursor_execute", execute)

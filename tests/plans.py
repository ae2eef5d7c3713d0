"""How a database goes about what it is asked."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import Any

import sqlalchemy as sa


@contextlib.contextmanager
def plans(engine: sa.Engine) -> Iterator[list[str]]:
    """Plans of the statements that are sent during the block, in order, a line for each step."""
    word = "EXPLAIN QUERY PLAN" if engine.dialect.name == "sqlite" else "EXPLAIN"
    found: list[str] = []

    def explain(_c: object, cursor: Any, query: str, values: Any, *_more: object) -> None:
        steps = cursor.execute(f"{word} {query}", values).fetchall()
        found.append("\n".join(str(step[-1]) for step in steps))

    sa.event.listen(engine, "before_cursor_execute", explain)
    try:
        yield found
    finally:
        sa.event.remove(engine, "before_cursor_execute", explain)

"""The moves of jobs from state to state, each one compare-and-set.

They follow the table in service.rows.states. Counted where they are written, no way to end is
missed.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import sqlalchemy as sa

from service import counters
from service.rows.clock import now
from service.rows.database import once_committed
from service.rows.states import ENDED, State, before
from service.rows.tables import jobs

NO_REQUEST: dict[str, None] = {"request": None, "request_until": None}
"""Whatever follows a request ends it."""


def move(
    connection: sa.Connection, state: State, which: sa.ColumnElement[bool], **values: Any
) -> bool:
    """Take jobs to a state, as far as they may go there; true when exactly one did.

    values: what else becomes of their columns.
    """
    values = {"state": state, **NO_REQUEST, **values}
    moved = connection.execute(
        update(sa.and_(which, jobs.c.state.in_(before(state)))).values(values)
    )
    if state in ENDED and state != State.EXPIRED:
        count = partial(counters.FINISHED.labels(state.value).inc, moved.rowcount)
        once_committed(connection, count)
    return moved.rowcount == 1


def update(which: sa.ColumnElement[bool]) -> sa.Update:
    """Start an UPDATE of jobs, which tells whoever watches them that something has changed."""
    return sa.update(jobs).where(which).values(revision=jobs.c.revision + 1)


def end(
    connection: sa.Connection,
    which: sa.ColumnElement[bool],
    state: State,
    keep_seconds: float | None,
    **values: Any,
) -> bool:
    """Take jobs to a state in which they end; true when exactly one did. No job ends otherwise.

    keep_seconds: how long they are kept from now on; None: for ever.
    """
    if keep_seconds is not None:  # a job that was condemned stays so
        values["expires"] = sa.func.coalesce(jobs.c.expires, now() + keep_seconds)
    return move(connection, state, which, worker=None, eta=None, finished=now(), **values)

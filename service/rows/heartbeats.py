"""The rows of workers: which live, by the database's clock, so that no host's clock matters."""

from __future__ import annotations

import sqlalchemy as sa

from service.rows.clock import now
from service.rows.tables import workers


def beat(connection: sa.Connection, worker: str) -> None:
    """Say that a worker lives."""
    seen = connection.execute(sa.update(workers).where(workers.c.id == worker).values(seen=now()))
    if seen.rowcount == 0:
        connection.execute(sa.insert(workers).values(id=worker, seen=now()))


def leave(connection: sa.Connection, worker: str) -> None:
    """Say that a worker ends; what it still holds may be taken over at once."""
    connection.execute(sa.delete(workers).where(workers.c.id == worker))


def live_on(connection: sa.Connection, host: str) -> bool:
    """Whether there are workers on a host, by service.workers.host; their ids begin with it."""
    ids = connection.execute(sa.select(workers.c.id)).scalars()
    return any(worker.rsplit("-", 2)[0] == host for worker in ids)


def living(connection: sa.Connection, silence_seconds: float) -> set[str]:
    """Workers heard of lately. Forgets the others."""
    # The database's clock was set back: the dead would live until it is as late again.
    late = sa.update(workers).where(workers.c.seen > now())
    connection.execute(late.values(seen=now()))
    connection.execute(sa.delete(workers).where(workers.c.seen < now() - silence_seconds))
    return set(connection.execute(sa.select(workers.c.id)).scalars())

"""What the table of jobs costs when it is full: python -m tests.bench.rows [--url postgresql://…].

Two databases, one with 1,000 rows of jobs and one with 1,000,000, as many of them waiting in both;
everything that the service does with rows is done in both by turns, and the medians and their
ratio are printed. The bytes of a key are added up anew for its quota, so that may grow with a key's
jobs; nothing else may. Without --url it measures SQLite in a temporary folder; with the URL of a
PostgreSQL database it makes two others beside that one and drops them afterwards.
"""

from __future__ import annotations

import argparse
import contextlib
import tempfile
import time
import uuid
from collections.abc import Callable, Iterator
from pathlib import Path
from statistics import median
from typing import Any

import sqlalchemy as sa

from service import answers, migrations
from service.dbos_queue.queue import Queue, migrate
from service.rows import attempts, database, expiry, jobs, quotas, tables, waiting
from service.settings import Settings

_SMALL, _LARGE = 1_000, 1_000_000
_WAITING = 500
_OWNERS = 10
_ROUNDS = 200
_DAY = 86400.0
_LIKENESS = "best-best bytes-44"
_SECONDS = {"layers": 10.0, "store": 1.0}
_LIMITED = "owner2"  # the one with a quota of bytes
_QUOTA_OF_BYTES = "quota of bytes"
_RANDOM_ID = {
    "sqlite": "lower(hex(randomblob(16)))",
    "postgresql": "replace(gen_random_uuid()::text, '-', '')",
}
_RESULT = {"name": "layers.exr", "size": 1, "sha256": "0" * 64, "media_type": "image/x-exr"}


class Rows:
    """A database with many rows, and what the service does with them."""

    def __init__(self, url: str, count: int) -> None:
        self.engine = database.connect(url)
        migrate(self.engine)
        migrations.upgrade(self.engine)
        self.queue = Queue(self.engine)
        self._settings = Settings()
        self._live()
        self._fill(count - _WAITING)
        for number in range(_WAITING):
            self.accept(f"owner{number % _OWNERS}")
        with self.engine.connect() as connection:
            query = sa.select(tables.jobs).where(tables.jobs.c.owner == "owner1")
            query = query.order_by(tables.jobs.c.created)
            middle = connection.execute(query.offset(count // _OWNERS // 2).limit(1)).one()
            self._middle = middle.created, middle.id
            self._last = jobs.page(connection, "owner1", 1, None)[0]

    def _live(self) -> None:
        """Have a worker that lives throughout, without which no job has an end, and a key."""
        key = {"id": _LIMITED, "digest": "", "name": "", "scopes": [], "stored_bytes": 2**62}
        with self.engine.begin() as connection:
            worker = {"id": "worker", "seen": time.time() + _DAY}
            connection.execute(sa.insert(tables.workers), worker)
            connection.execute(sa.insert(tables.keys), key | {"created": time.time()})

    def _fill(self, count: int) -> None:
        """Insert jobs that have ended, of _OWNERS owners; those that were there, doubled."""
        ended = {
            "state": "succeeded",
            "options": {"lights": 2},
            "likeness": _LIKENESS,
            "stage_seconds": _SECONDS,
            "stored_bytes": 1,
            "inputs": {frame: {"key": "", "sha256": "0" * 64} for frame in ("no_flash", "flash")},
            "results": [_RESULT] * 2,
            "trace_id": "0" * 32,
            "request_hash": "0" * 64,
            "created": time.time() - 30 * _DAY,
            "finished": time.time(),
            "expires": time.time() + 30 * _DAY,
        }
        first = [
            {"id": uuid.uuid4().hex, "owner": f"owner{number % _OWNERS}", **ended}
            for number in range(_OWNERS)
        ]
        table = tables.jobs
        fresh = {
            "id": sa.literal_column(_RANDOM_ID[self.engine.dialect.name]),
            "created": table.c.created + 1,
        }
        columns = [fresh.get(column.name, column) for column in table.columns]
        with self.engine.begin() as connection:
            connection.execute(sa.insert(table), first)
        have = len(first)
        while have < count:
            more = min(have, count - have)
            with self.engine.begin() as connection:
                copies = sa.select(*columns).limit(more)
                connection.execute(sa.insert(table).from_select(list(table.columns), copies))
            have += more
        if self.engine.dialect.name == "postgresql":  # as it does by itself, after a while
            with self.engine.begin() as connection:
                connection.exec_driver_sql("ANALYZE")

    def accept(self, owner: str = "owner1") -> None:
        """Add a job, with all that is asked before."""
        with self.engine.connect() as connection:
            jobs.find_by_key(connection, owner, "no such key")
            waiting.count_queued(connection, owner)
            waiting.count_queued(connection)
        job_id = uuid.uuid4().hex
        row = {"options": {}, "trace_id": "0" * 32, "request_hash": "0" * 64}
        row |= {"likeness": _LIKENESS}
        with self.engine.begin() as connection:
            rank = jobs.add(connection, {"id": job_id, "owner": owner, **row})
            self.queue.submit(connection, job_id, rank)
        self._new = job_id

    def claim(self) -> None:
        """Start an attempt at the job that came last."""
        with self.engine.begin() as connection:
            self._held = attempts.claim(connection, self._new, "worker")

    def look(self) -> None:
        """Ask, as an attempt does, whether to stop."""
        assert self._held is not None
        with self.engine.connect() as connection:
            assert not attempts.must_stop(connection, self._held)

    def end(self) -> None:
        """Make the held job succeed."""
        assert self._held is not None
        with self.engine.begin() as connection:
            assert attempts.succeed(connection, self._held, [_RESULT] * 2, _SECONDS, _DAY)

    def state(self) -> None:
        """Read one job."""
        with self.engine.connect() as connection:
            jobs.find(connection, self._new)

    def answer(self) -> None:
        """Tell of a job that waits, with its place in the queue and its end."""
        with self.engine.connect() as connection:
            (told,) = answers.of_jobs(connection, self._settings, [self._last])
        assert told.position is not None and told.position > 1
        assert told.eta is not None

    def first_page(self) -> None:
        """List an owner's newest jobs, with their places and ends."""
        self._page(None)

    def later_page(self) -> None:
        """List an owner's jobs from the middle on."""
        self._page(self._middle)

    def _page(self, after: tuple[float, str] | None) -> None:
        with self.engine.connect() as connection:
            found = jobs.page(connection, "owner1", 51, after)
            assert answers.of_jobs(connection, self._settings, found)

    def bytes_of_key(self) -> None:
        """Add up what a key's jobs have stored."""
        with self.engine.connect() as connection:
            quotas.check(connection, _LIMITED)

    def calibrations(self) -> None:
        """Look for an owner's calibrations, as a separation does."""
        with self.engine.connect() as connection:
            assert jobs.kept_calibrations(connection, "owner1", None) == []

    def upkeep(self) -> None:
        """Look for what is late, is to be dated, or is kept no longer."""
        with self.engine.begin() as connection:
            assert waiting.overdue(connection, 100) == []
            expiry.limit_keeping(connection, _DAY, 500)
            assert expiry.expire(connection, 500) == []

    def close(self) -> None:
        """Stop using the database."""
        self.queue.close()
        self.engine.dispose()


OPERATIONS: dict[str, Callable[[Rows], None]] = {
    "accept": Rows.accept,
    "claim": Rows.claim,
    "look": Rows.look,
    "state": Rows.state,
    "end": Rows.end,
    "answer": Rows.answer,
    "list, first page": Rows.first_page,
    "list, a page in the middle": Rows.later_page,
    "calibrations": Rows.calibrations,
    "upkeep": Rows.upkeep,
    _QUOTA_OF_BYTES: Rows.bytes_of_key,
}


def measure(small: Rows, large: Rows, rounds: int) -> dict[str, tuple[float, float]]:
    """Median seconds of every operation with few rows and with many."""
    times: dict[str, tuple[list[float], list[float]]] = {name: ([], []) for name in OPERATIONS}
    for _ in range(rounds):
        for rows, place in ((small, 0), (large, 1)):
            for name, do in OPERATIONS.items():
                start = time.perf_counter()
                do(rows)
                times[name][place].append(time.perf_counter() - start)
    return {name: (median(few), median(many)) for name, (few, many) in times.items()}


@contextlib.contextmanager
def databases(url: str | None) -> Iterator[tuple[str, str]]:
    """Make two empty databases; their URLs."""
    if url is None:
        with tempfile.TemporaryDirectory() as folder:
            small, large = (
                f"sqlite:///{Path(folder) / name}.sqlite" for name in ("small", "large")
            )
            yield small, large
        return
    server = database.connect(url).execution_options(isolation_level="AUTOCOMMIT")
    names = [f"rows_{uuid.uuid4().hex[:8]}_{size}" for size in ("small", "large")]
    with server.connect() as connection:
        for name in names:
            connection.exec_driver_sql(f"CREATE DATABASE {name}")
        try:
            small, large = (
                sa.make_url(url).set(database=name).render_as_string(hide_password=False)
                for name in names
            )
            yield small, large
        finally:
            for name in names:
                connection.exec_driver_sql(f"DROP DATABASE {name} WITH (FORCE)")
    server.dispose()


def bears(measured: dict[str, tuple[float, float]]) -> bool:
    """Whether nothing that may not grow costs more than twice as much with many rows."""
    return all(many <= 2 * few for name, (few, many) in measured.items() if name != _QUOTA_OF_BYTES)


def report(measured: dict[str, tuple[float, float]], few: int, many: int) -> str:
    """Write the table."""
    lines = [f"| | {few:,} rows, ms | {many:,} rows, ms | ratio |", "|---|---:|---:|---:|"]
    for name, (small, large) in measured.items():
        lines.append(f"| {name} | {small * 1e3:.2f} | {large * 1e3:.2f} | {large / small:.2f} |")
    return "\n".join(lines)


def main() -> int:
    """Measure and print; 1 when something costs more than twice as much with many rows."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench.rows")
    parser.add_argument("--url", help="postgresql://… of a server; without it, SQLite")
    parser.add_argument("--rows", type=int, default=_LARGE, help="rows of the full table")
    asked: Any = parser.parse_args()
    with databases(asked.url) as (small_url, large_url):
        small, large = Rows(small_url, _SMALL), Rows(large_url, asked.rows)
        measured = measure(small, large, _ROUNDS)
        small.close()
        large.close()
    print(report(measured, _SMALL, asked.rows))  # noqa: T201  the command's output
    return int(not bears(measured))


if __name__ == "__main__":
    raise SystemExit(main())

"""At the end: what the service promised, and what became of it."""

from __future__ import annotations

import contextlib
import json
import subprocess
import time
from collections import Counter, defaultdict
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import sqlalchemy as sa

from service.opening import open_storage
from service.rows import tables
from service.rows.states import ENDED
from tests.chaos.clients import Accepted, Clients, Ledger
from tests.chaos.service import Service
from tests.chaos.takeovers import Takeovers

_SETTLE_SECONDS = 150.0
_SWEEP_SECONDS = 60.0
_LEAVE_SECONDS = 60.0
_EXCUSED = ("out-of-memory", "crashed", "abandoned")
"""How a job may fail whose process or workers were killed under it."""

Rows = dict[str, Any]


@dataclass
class Accounts:
    """What is wrong, in sentences; each list must be empty."""

    lost: list[str] = field(default_factory=list)
    stuck: list[str] = field(default_factory=list)
    doubled: list[str] = field(default_factory=list)
    orphans: list[str] = field(default_factory=list)

    @property
    def sound(self) -> bool:
        """Whether nothing is wrong."""
        return not any(vars(self).values())


def settle(engine: sa.Engine, ledger: Ledger) -> list[str]:
    """Wait until every job has ended; those that have not."""
    deadline = time.monotonic() + _SETTLE_SECONDS
    while True:
        open_jobs = [row for row in _rows(engine).values() if row.state not in ENDED]
        if not open_jobs or time.monotonic() > deadline:
            break
        time.sleep(0.5)
    return [
        *(f"{row.id} is {row.state} in attempt {row.attempt}" for row in open_jobs),
        *ledger.impatient,
    ]


def reckon(
    service: Service, engine: sa.Engine, clients: Clients, takeovers: Takeovers, ledger: Ledger
) -> Accounts:
    """Compare what clients were told with what is there; the service must have settled."""
    accounts = Accounts(doubled=list(ledger.doubled))
    rows = _rows(engine)
    said = _said(service)
    for job_id, accepted in ledger.jobs.items():
        name = f"{job_id} ({accepted.key})"
        if accepted.deleted:
            if job_id in rows:
                accounts.orphans.append(f"{name} was deleted, but its row is there")
            continue
        if job_id not in rows:
            accounts.lost.append(f"{name} has no row")
            continue
        row = rows[job_id]
        if fault := _wrong_outcome(row, accepted, takeovers.losses.get(job_id, 0), clients):
            accounts.lost.append(f"{name}: {fault}")
        if fault := _second_outcome(row, accepted, said[job_id]):
            accounts.doubled.append(f"{name}: {fault}")
    accounts.doubled += [f"{key}: {n} rows" for key, n in _keys(rows).items() if n > 1]
    known = {accepted.key for accepted in ledger.jobs.values()}
    accounts.orphans += [
        f"{row.id} ({row.idempotency_key}) is nobody's"
        for row in rows.values()
        if row.id not in ledger.jobs and row.idempotency_key not in known
    ]
    accounts.orphans += _stray(service, rows, ledger.jobs)
    return accounts


def _rows(engine: sa.Engine) -> Rows:
    with engine.connect() as connection:
        return {row.id: row for row in connection.execute(sa.select(tables.jobs))}


def _keys(rows: Rows) -> Counter[str]:
    return Counter(row.idempotency_key for row in rows.values())


def _wrong_outcome(row: Any, accepted: Accepted, losses: int, clients: Clients) -> str | None:
    if row.state == "succeeded":
        return clients.wrong_results(row.id)
    if row.state == "canceled":
        return None if accepted.wish.then == "cancel" else "canceled, but nobody asked for that"
    if row.state == "failed":
        kind = row.error["type"].rpartition(":")[2]
        return None if losses and kind in _EXCUSED else f"failed: {row.error['detail']}"
    return None  # not ended: it is among the stuck ones


def _second_outcome(row: Any, accepted: Accepted, said: list[str]) -> str | None:
    if len(said) > 1:
        return f"the log has the ends {said}"
    told = accepted.end
    if told is None:
        return None
    now = (row.state, row.attempt, {file["sha256"] for file in row.results or []})
    then = (told["state"], told["attempt"], {file["sha256"] for file in told["files"]})
    return None if now == then else f"{then[:2]} once, {now[:2]} now"


def _said(service: Service) -> dict[str, list[str]]:
    """Ends of jobs by the logs of all hosts."""
    ends: dict[str, list[str]] = defaultdict(list)
    for entry in _entries(service):
        if entry.get("logger") == "service.workers.attempt":
            end = entry["message"].partition(":")[0]
            if end in ("succeeded", "failed", "canceled"):
                ends[entry["job"]].append(end)
    return ends


def _entries(service: Service) -> Iterator[dict[str, Any]]:
    """Lines of all hosts' logs."""
    for host in service.hosts:
        for line in host.log.read_text(errors="replace").splitlines():
            with contextlib.suppress(ValueError):  # a line that a kill cut short
                entry = json.loads(line)
                if isinstance(entry, dict):
                    yield entry


def noticed(service: Service, takeovers: Takeovers) -> list[float]:
    """Seconds until a living worker had put each job that was taken over back into the queue.

    Without those whose line a kill kept out of the log.
    """
    back: dict[str, list[float]] = defaultdict(list)
    for entry in _entries(service):
        if entry.get("message") == "taken over":
            back[entry["job"]].append(datetime.fromisoformat(entry["time"]).timestamp())
    return [
        min(after)
        for (job_id, since), took in zip(takeovers.lost_at, takeovers.seconds, strict=True)
        if (after := [when - since for when in back[job_id] if since < when <= since + took])
    ]


def _stray(service: Service, rows: Rows, known: Collection[str]) -> list[str]:
    """Objects and scratch folders that belong to nothing, once workers have had time to clear."""
    deadline = time.monotonic() + _SWEEP_SECONDS
    while True:
        found = [
            *_stray_objects(service, rows, known),
            *(
                f"scratch folder {path.name} of {host.data.parent.name}"
                for host in service.hosts
                for path in (host.data / "work").glob("*")
            ),
        ]
        if not found or time.monotonic() > deadline:
            return found
        time.sleep(1)


def _stray_objects(service: Service, rows: Rows, known: Collection[str]) -> list[str]:
    # Photographs of an upload that was never answered have no job; a sweep removes them in a day.
    stray = []
    for key in _stored(service):
        _, job_id, part, _ = key.split("/", 3)
        row = rows.get(job_id)
        if row is None:
            if job_id in known:
                stray.append(f"{key} has no row")
        elif part == "inputs":
            if key not in [one["key"] for one in (row.inputs or {}).values()]:
                stray.append(f"{key} is not of its job")
        elif row.state != "succeeded" or part != str(row.attempt):
            stray.append(f"{key} is of an attempt that does not count")
    return stray


def _stored(service: Service) -> list[str]:
    """Keys of all objects; on a disk, of all files: a put that was cut short leaves no object."""
    url = urlsplit(service.settings.store_url)
    if url.scheme != "file":
        return open_storage(service.settings).list("jobs")
    folder = Path(url.path)
    files = [path for path in (folder / "jobs").rglob("*") if path.is_file()]
    return [str(path.relative_to(folder)) for path in files]


def leftovers(service: Service) -> list[str]:
    """Ask every host to end: processes that are still there."""
    found = []
    for host in service.hosts:
        try:
            host.stop()
        except subprocess.TimeoutExpired:
            found.append(f"{host.data.parent.name} does not end")
    deadline = time.monotonic() + _LEAVE_SECONDS
    while (left := _left(service)) and time.monotonic() < deadline:
        time.sleep(0.2)
    return found + left


def _left(service: Service) -> list[str]:
    return [
        f"process {one.role} of {host.data.parent.name}"
        for host in service.hosts
        for one in host.processes()
    ]

"""How much of a job is done, and when it is likely to end, by what jobs like it took lately.

Jobs are alike when they have the same kind and quality and about as many bytes to read; the column
`likeness` says so in few letters, so that the last ones are found through an index.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from statistics import fmean, median
from typing import Any

import sqlalchemy as sa

from pipeline.progress import STAGES
from service.rows.census import living_workers
from service.rows.clock import now
from service.rows.jobs import Job
from service.rows.states import HELD, State
from service.rows.tables import jobs
from service.settings import Settings

_RECENT = 20  # jobs like one that its pace is told by
_ORDER = ("fetch", "capture", *STAGES, "calibrate", "mix", "store")
"""Everything that attempts do, in order: photographs fetched, the stages, results stored."""

_FIRST_SHARES = {
    "separate": {"decode": 10, "align": 20, "lamps": 17, "layers": 46, "encode": 6, "store": 1},
    "calibrate": {"decode": 45, "align": 30, "calibrate": 24, "store": 1},
    "mix": {"mix": 90, "store": 10},
}
"""Of the time, in hundredths, while no job like this one has succeeded: of a separation near what
the three pairs in docs/performance.md take, imports aside; of the others a guess."""

_CAPTURE_SHARE = 10  # in the same hundredths, which then add up to more: a guess


def likeness(options: Mapping[str, Any], size: int, capture: Mapping[str, Any] | None) -> str:
    """Say in up to 64 letters what of a job its time depends on.

    options: as in the job's row. size: bytes of the pair; classes are half as wide as a doubling.
    """
    if capture:
        camera = json.dumps({"camera": capture["camera"]})
        digest = hashlib.sha256(camera.encode()).hexdigest()
        measure = f"camera-{digest[:12]}"
    else:
        measure = f"bytes-{round(2 * math.log2(max(size, 1)))}"
    if options.get("kind") == "mix":
        return f"mix-{options['mix'].get('format', 'jpeg')} {measure}"
    if "kind" in options:
        return f"calibrate-{options['kind']} {measure}"
    what = [options.get("quality", "best"), options.get("method", "best")]
    what += [name for name in ("light_directions", "response") if options.get(name)]
    return f"{'-'.join(what)} {measure}"


@dataclass(frozen=True)
class Pace:
    """What jobs like one spend their time on: shares by stage, and seconds, None when unknown."""

    shares: dict[str, float]
    seconds: float | None

    def progress(self, stage: str, fraction: float) -> float:
        """How much of the whole is done, 0…1, when so much of a stage is."""
        if stage not in _ORDER:
            return 0.0
        before = sum(self.shares.get(earlier, 0.0) for earlier in _ORDER[: _ORDER.index(stage)])
        return min(before + fraction * self.shares.get(stage, 0.0), 1.0)


def pace_of(connection: sa.Connection, job: Job) -> Pace:
    """Learn the pace of a job from the last ones like it."""
    alike = _recent(connection, jobs.c.likeness == job.likeness) if job.likeness else []
    if not alike:
        hundredths = dict(_FIRST_SHARES[job.task])
        if job.capture and not job.inputs:
            hundredths["capture"] = _CAPTURE_SHARE
        whole = sum(hundredths.values())
        return Pace({stage: part / whole for stage, part in hundredths.items()}, None)
    totals = [sum(seconds.values()) for seconds in alike]
    shares = {
        stage: fmean(
            seconds.get(stage, 0.0) / total for seconds, total in zip(alike, totals, strict=True)
        )
        for stage in _ORDER
    }
    return Pace(shares, median(totals))


def _recent(connection: sa.Connection, which: sa.ColumnElement[bool]) -> list[dict[str, float]]:
    """Seconds by stage of the last jobs that succeeded."""
    query = (
        sa.select(jobs.c.stage_seconds)
        .where(which, jobs.c.state == State.SUCCEEDED)
        .order_by(jobs.c.created.desc())
        .limit(_RECENT)
    )
    found = connection.execute(query).scalars()
    return [seconds for seconds in found if seconds and sum(seconds.values()) > 0]


class Track:
    """How far one attempt is."""

    def __init__(self, pace: Pace) -> None:
        self._pace = pace
        self.progress = 0.0

    def reach(self, stage: str, fraction: float) -> None:
        """Say how much of a stage is done, 0…1; `progress` never falls."""
        self.progress = max(self.progress, self._pace.progress(stage, fraction))

    @property
    def seconds_left(self) -> float | None:
        """What is left of the attempt, in seconds; None when no job like it is known."""
        return None if self._pace.seconds is None else self._pace.seconds * (1 - self.progress)


def etas(
    connection: sa.Connection, settings: Settings, shown: Iterable[Job], places: Mapping[str, int]
) -> dict[str, float]:
    """When jobs are likely to end, by id, in seconds since 1970, as far as that can be told.

    places: position in the queue of those that wait. For a job that runs its worker writes the
    time; one that has passed tells nothing any more.
    """
    shown = list(shown)
    if all(job.ended for job in shown):
        return {}
    moment = connection.execute(sa.select(now())).scalar_one()
    found = {
        job.id: job.eta
        for job in shown
        if job.state == State.RUNNING and job.eta is not None and job.eta > moment
    }
    waiting = [job for job in shown if job.state == State.QUEUED and job.id in places]
    if not waiting:
        return found
    usual = [sum(seconds.values()) for seconds in _recent(connection, sa.true())]
    slots = living_workers(connection, settings.silence_seconds) * settings.worker_concurrency
    if not usual or not slots:
        return found
    held = sa.select(sa.func.count()).select_from(jobs).where(jobs.c.state.in_(HELD))
    running = connection.execute(held).scalar_one()
    paces: dict[str, Pace] = {}
    for job in waiting:
        if job.likeness not in paces:
            paces[job.likeness] = pace_of(connection, job)
        own = paces[job.likeness].seconds
        if own is not None:
            wait = _wait(places[job.id], running, slots) * median(usual)
            found[job.id] = moment + wait + own
    return found


def _wait(position: int, running: int, slots: int) -> float:
    """How many usual jobs long a job waits, with those that run half done in the mean."""
    ahead = position - 1
    return 0.0 if ahead + running < slots else (ahead + running / 2) / slots

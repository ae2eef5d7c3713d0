"""The queues from inside a worker: what comes out of them, and how often it is looked for."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial

import sqlalchemy as sa
from dbos import DBOS, DBOSConfig, DBOSPortableJSONSerializer, error

from service.dbos_queue.entries import (
    APPLICATION,
    CAPTURE_PAIR,
    DELIVERIES,
    JOBS,
    RUN_JOB,
    SWEEP,
    TELL_WEBHOOK,
    UPKEEP,
    VERSION,
    captures_on,
    times_put_back,
)
from service.dbos_queue.outages import shorten_outages
from service.dbos_queue.queue import Queue
from service.dbos_queue.sweeps import call_sweeps
from service.errors import StartError

_CAPTURERS = 16  # cameras that a worker has take pairs at once: it waits for them most of the time
_DELIVERIES = 8  # that a worker makes at once: it waits for them most of the time
_DELIVERY_SECONDS = 2.0  # each look at a queue costs every worker some 5 ms of its processor
_CAPTURE_SECONDS = 1.0  # a look at cameras costs more than one at jobs
_LONGEST_UPKEEP_SECONDS = 5  # between two looks at its queue
_SCHEDULES = ("often", "hourly")  # that the version before had DBOS keep


@dataclass(frozen=True)
class Duties:
    """What a worker does, in threads, with what comes out of the queues.

    run(job id, times that it was put back): must return only when the job has ended, or is queued
    once more, since a return takes the job out of the queue for good. capture(job id): when its
    pair is taken. deliver(job id, number): when what came of it is written. sweep(its id in the
    queue, thorough): called in one worker at a time, often with false, every hour with true.
    """

    run: Callable[[str, int], None]
    capture: Callable[[str], None]
    deliver: Callable[[str, int], None]
    sweep: Callable[[str, bool], None]


@dataclass(frozen=True)
class Pace:
    """How much a worker does at once, and how often it looks.

    concurrency: jobs at a time. poll_seconds: between two looks at a queue. sweep_seconds: 1…60.
    """

    concurrency: int
    poll_seconds: float
    sweep_seconds: int


def launch(engine: sa.Engine, worker: str, host: str | None, duties: Duties, pace: Pace) -> None:
    """Have this process do its duties from now on.

    worker: unique among all workers ever. host: on whose USB it uses cameras, beside those that any
    worker can; None where there is no other host. Raises StartError.
    """
    shorten_outages(worker)
    DBOS(
        config=DBOSConfig(
            name=APPLICATION,
            system_database_engine=engine,
            executor_id=worker,
            application_version=VERSION,
            serializer=DBOSPortableJSONSerializer(),
            log_level="WARNING",
            run_migrations=False,  # a command does that, see service.opening
            notification_coalesce_sec=1.0,  # nothing is sent, and it woke a hundred times a second
        )
    )
    _assign(duties)
    captures = {captures_on(None), captures_on(host)}
    DBOS.listen_queues([JOBS, *captures, DELIVERIES, UPKEEP])
    try:
        DBOS.launch()
    except error.DBOSInitializationError as fault:
        raise StartError(
            "The queue's tables are older than this lightlayers needs: run `lightlayers migrate`."
        ) from fault
    _register_queues(captures, captures_on(host), pace)
    for schedule in _SCHEDULES:
        DBOS.delete_schedule(schedule)
    calling = (Queue(engine), engine, worker, pace.sweep_seconds)
    threading.Thread(target=call_sweeps, args=calling, daemon=True).start()


def _assign(duties: Duties) -> None:
    """Say what is done for the entries of each queue."""
    # An attempt count of our own is in the job's row: a takeover resets the one of DBOS.
    workflow = partial(DBOS.workflow, max_recovery_attempts=None)
    # DBOS marks the functions that it is given, and bound methods cannot be marked.
    # Its id tells the number: a worker of the version before takes no other argument.
    workflow(name=RUN_JOB)(lambda job_id: duties.run(job_id, times_put_back(str(DBOS.workflow_id))))
    workflow(name=CAPTURE_PAIR)(lambda job_id: duties.capture(job_id))
    workflow(name=TELL_WEBHOOK)(lambda job_id, number: duties.deliver(job_id, number))
    # None: workers of the version before give it a time there.
    workflow(name=SWEEP)(lambda _, thorough: duties.sweep(str(DBOS.workflow_id), thorough))


def _register_queues(captures: Iterable[str], own: str, pace: Pace) -> None:
    """Register the queues. own: of those of captures, that of this worker's USB."""
    register = partial(DBOS.register_queue, on_conflict="always_update")
    poll = pace.poll_seconds
    register(JOBS, worker_concurrency=pace.concurrency, polling_interval_sec=poll)
    for queue in captures:
        register(
            queue,
            worker_concurrency=_CAPTURERS,
            partition_concurrency=1,
            # Somebody stands at a camera on USB, and waits for it; others are seldom used.
            polling_interval_sec=poll if queue == own else max(poll, _CAPTURE_SECONDS),
        )
    register(
        DELIVERIES,
        worker_concurrency=_DELIVERIES,
        polling_interval_sec=max(poll, _DELIVERY_SECONDS),
    )
    register(
        UPKEEP,
        global_concurrency=1,
        polling_interval_sec=min(pace.sweep_seconds, _LONGEST_UPKEEP_SECONDS),
    )

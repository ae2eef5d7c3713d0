"""The durable queues: submit, withdraw, run, take over, sweep. The only module that knows DBOS.

DBOS remembers what was submitted through every crash and hands each job to one worker; what it
does not do is take over the jobs of a worker that died, so workers do (Queue.held and put_back),
and forget the ones that are done, so forget_done() does.
"""

from __future__ import annotations

import logging
import re
import sys
import threading
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import partial

import psycopg
import sqlalchemy as sa
from dbos import (
    DBOS,
    DBOSClient,
    DBOSConfig,
    DBOSPortableJSONSerializer,
    EnqueueOptions,
    error,
)

from service.errors import StartError
from service.patience import note
from service.problems import DATABASE_AWAY, cause_of
from service.rows.clock import now
from service.rows.database import AWAY

_APPLICATION = "lightlayers"
_VERSION = "1"  # pinned: a job of an older program may be run by a newer one
JOBS = "jobs"
"""The queue of jobs."""

CAPTURES = "captures"
"""The queues of cameras, one each: jobs wait here until theirs has taken their pair.

Those that hang on a host's USB have theirs in a queue of that host, see captures_on.
"""

_WORKFLOW = "run_job"
_CAPTURE = "capture_pair"
_CAPTURERS = 16  # cameras that a worker has take pairs at once: it waits for them most of the time
_DELIVERY_QUEUE = "webhooks"
_DELIVERY_WORKFLOW = "tell_webhook"  # the name that entries in databases have
_DELIVERIES = 8  # that a worker makes at once: it waits for them most of the time
_DELIVERY_SECONDS = 2.0  # each look at a queue costs every worker some 5 ms of its processor
_CAPTURE_SECONDS = 1.0  # a look at cameras costs more than one at jobs
_UPKEEP = "upkeep"
_LONGEST_UPKEEP_SECONDS = 5  # between two looks at its queue
_SWEEP = "sweep"
_HOUR_SECONDS = 3600
_SCHEDULES = ("often", "hourly")  # that the version before had DBOS keep
_AGAIN = re.compile(r"-again-(\d+)$")  # as run_id makes them
_OF_A_JOB = re.compile(r"-(capture|(again|webhook)-\d+)$")  # as capture_id and delivery_id do
_HINDERED = (sa.exc.DBAPIError, psycopg.Error, *AWAY)  # it waits for notifications by itself
_OUTAGE_SECONDS = 10.0  # between two lines on what hinders the queue
_DONE = ["SUCCESS", "ERROR", "CANCELLED"]
_BATCH = 500  # forgotten in a transaction

log = logging.getLogger("service.dbos_queue")


def migrate(engine: sa.Engine) -> None:
    """Create or bring up to date the queue's tables; before the first Queue or launch."""
    _silence_dbos()  # it warns of what it can do without; whatever else fails is raised
    DBOS.migrate(engine.url.render_as_string(hide_password=False))


def _silence_dbos() -> None:
    # It writes to the console of its own unless its logger has a handler.
    logging.getLogger("dbos").addHandler(logging.NullHandler())


@dataclass(frozen=True)
class Held:
    """What a worker has taken out of a queue; in that of jobs, id is as run_id makes it."""

    id: str
    worker: str
    queue: str

    @property
    def work(self) -> str:
        """Name of the work, done once at a time: the id without how often it was put back."""
        return _AGAIN.sub("", self.id)

    @property
    def job(self) -> str:
        """Id of the job that it is about; of a sweep, its own."""
        return _OF_A_JOB.sub("", self.id)

    @property
    def runs(self) -> bool:
        """Whether it is a job itself, or its capture."""
        return self.queue not in (_DELIVERY_QUEUE, _UPKEEP)


class Queue:
    """The queue from outside: it puts in and takes out, and raises when the database is away.

    What DBOS does inside a worker waits for the database instead, and ever longer.
    """

    def __init__(self, engine: sa.Engine) -> None:
        self._client = DBOSClient(
            system_database_engine=engine,
            serializer=DBOSPortableJSONSerializer(),
            application_name=_APPLICATION,
            retry_connection_errors=False,
        )

    def submit(
        self,
        connection: sa.Connection,
        job_id: str,
        rank: int,
        again: int = 0,
        delay_seconds: float = 0.0,
    ) -> None:
        """Enqueue a job within the caller's transaction; those of low rank (1…2³¹−1) go first.

        again: how many times a worker has put it back for another one.
        One that is enqueued already stays as it is, here and in submit_capture.
        """
        options = EnqueueOptions(
            workflow_name=_WORKFLOW,
            queue_name=JOBS,
            workflow_id=run_id(job_id, again),
            priority=rank,
        )
        self._enqueue(connection, options, delay_seconds, job_id)

    def submit_capture(
        self,
        connection: sa.Connection,
        job_id: str,
        rank: int,
        camera: str,
        host: str | None,
        delay_seconds: float = 0.0,
    ) -> None:
        """Enqueue a job for its camera, within a transaction; one job at a time has each camera.

        host: whose workers alone can use it; None for any.
        """
        options = EnqueueOptions(
            workflow_name=_CAPTURE,
            queue_name=captures_on(host),
            workflow_id=capture_id(job_id),
            priority=rank,
            queue_partition_key=camera,
        )
        self._enqueue(connection, options, delay_seconds, job_id)

    def submit_delivery(
        self, connection: sa.Connection, job_id: str, number: int, delay_seconds: float
    ) -> None:
        """Enqueue an attempt at delivery to a job's webhook, within a transaction.

        number: of the attempt, from 1. One that is enqueued already stays as it is.
        """
        options = EnqueueOptions(
            workflow_name=_DELIVERY_WORKFLOW,
            queue_name=_DELIVERY_QUEUE,
            workflow_id=delivery_id(job_id, number),
        )
        self._enqueue(connection, options, delay_seconds, job_id, number)

    def submit_sweep(self, connection: sa.Connection, seconds: int, thorough: bool) -> None:
        """Enqueue the sweep of the present `seconds` by the database's clock, in a transaction.

        One that is enqueued already, by whichever worker, stays as it is.
        """
        moment = connection.execute(sa.select(now())).scalar_one()
        kind = "thorough" if thorough else "often"
        options = EnqueueOptions(
            workflow_name=_SWEEP,
            queue_name=_UPKEEP,
            workflow_id=f"{_SWEEP}-{kind}-{int(moment // seconds)}",
        )
        self._enqueue(connection, options, 0.0, None, thorough)

    def _enqueue(
        self,
        connection: sa.Connection,
        options: EnqueueOptions,
        delay_seconds: float,
        *arguments: object,
    ) -> None:
        options["app_version"] = _VERSION
        if delay_seconds > 0:
            options["delay_seconds"] = delay_seconds
        self._client.enqueue_in_transaction(connection, options, *arguments)

    def withdraw(self, *job_ids: str) -> None:
        """Take jobs that wait out of their queues; of those put back, run finds no more to do."""
        self._client.cancel_workflows([*job_ids, *map(capture_id, job_ids)])

    def held(self) -> list[Held]:
        """List what workers have taken out of the queues and not done yet."""
        held = self._client.list_workflows(
            status="PENDING",
            queues_only=True,  # all of them, also those of other hosts
            load_input=False,
            load_output=False,
        )
        return [
            Held(one.workflow_id, one.executor_id or "", one.queue_name or JOBS) for one in held
        ]

    def put_back(self, held: Iterable[Held]) -> None:
        """Put what workers have back into its queue."""
        for one in held:
            self._client.resume_workflow(one.id, queue_name=one.queue)

    def forget_done(self, seconds: float) -> None:
        """Drop what was done more than so many seconds ago; the rows of jobs tell how it ended."""
        before = (datetime.now(UTC) - timedelta(seconds=seconds)).isoformat()
        while done := self._client.list_workflows(
            status=_DONE,
            completed_before=before,
            limit=_BATCH,
            load_input=False,
            load_output=False,
        ):
            self._client.delete_workflows([one.workflow_id for one in done])

    def close(self) -> None:
        """Stop using the queue; the engine stays the caller's."""
        self._client.destroy()


def captures_on(host: str | None) -> str:
    """Name the queue of the cameras on a host's USB; None: of those that any worker can use."""
    return CAPTURES if host is None else f"{CAPTURES}@{host}"


def run_id(job_id: str, again: int = 0) -> str:
    """Give the id that a job has in the queue of jobs: its own, until it is put back."""
    return f"{job_id}-again-{again}" if again else job_id


def capture_id(job_id: str) -> str:
    """Give the id that a job has in its camera's queue."""
    return f"{job_id}-capture"


def delivery_id(job_id: str, number: int) -> str:
    """Give the id that an attempt at delivery to a job's webhook has in its queue."""
    return f"{job_id}-webhook-{number}"


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


def _listen_to_dbos(worker: str) -> None:
    _silence_dbos()
    logging.getLogger("dbos").addFilter(_Outages(worker))


class _Outages(logging.Filter):
    """Makes one line each some seconds of what DBOS says of a database that is away.

    It says so at each look at each queue, in the words of sqlalchemy, with the statement.
    """

    def __init__(self, worker: str) -> None:
        super().__init__()
        self._worker = worker
        self._lock = threading.Lock()
        self._silent_until = 0.0

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether to write it. It is looked at where the error is handled that it tells of."""
        error = sys.exc_info()[1]
        if not isinstance(error, _HINDERED):
            return True
        with self._lock:
            if time.monotonic() < self._silent_until:
                return False
            self._silent_until = time.monotonic() + _OUTAGE_SECONDS
        said = f"the queue is hindered, {DATABASE_AWAY.name}: {cause_of(error)}"
        record.msg, record.args, record.exc_info = said, (), None
        record.worker = self._worker
        return True


def launch(engine: sa.Engine, worker: str, host: str | None, duties: Duties, pace: Pace) -> None:
    """Have this process do its duties from now on.

    worker: unique among all workers ever. host: on whose USB it uses cameras, beside those that any
    worker can; None where there is no other host. Raises StartError.
    """
    _listen_to_dbos(worker)
    DBOS(
        config=DBOSConfig(
            name=_APPLICATION,
            system_database_engine=engine,
            executor_id=worker,
            application_version=_VERSION,
            serializer=DBOSPortableJSONSerializer(),
            log_level="WARNING",
            run_migrations=False,  # a command does that, see service.opening
            notification_coalesce_sec=1.0,  # nothing is sent, and it woke a hundred times a second
        )
    )
    # An attempt count of our own is in the job's row: a takeover resets the one of DBOS.
    workflow = partial(DBOS.workflow, max_recovery_attempts=None)
    # DBOS marks the functions that it is given, and bound methods cannot be marked.
    # Its id tells the number: a worker of the version before takes no other argument.
    workflow(name=_WORKFLOW)(lambda job_id: duties.run(job_id, _again(str(DBOS.workflow_id))))
    workflow(name=_CAPTURE)(lambda job_id: duties.capture(job_id))
    workflow(name=_DELIVERY_WORKFLOW)(lambda job_id, number: duties.deliver(job_id, number))

    # None: workers of the version before give it a time there.
    workflow(name=_SWEEP)(lambda _, thorough: duties.sweep(str(DBOS.workflow_id), thorough))
    captures = {captures_on(None), captures_on(host)}
    DBOS.listen_queues([JOBS, *captures, _DELIVERY_QUEUE, _UPKEEP])
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
    threading.Thread(target=_call_sweeps, args=calling, daemon=True).start()


def _again(queued: str) -> int:
    """How many times the job was put back whose id in its queue this is."""
    number = _AGAIN.search(queued)
    return int(number[1]) if number else 0


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
        _DELIVERY_QUEUE,
        worker_concurrency=_DELIVERIES,
        polling_interval_sec=max(poll, _DELIVERY_SECONDS),
    )
    register(
        _UPKEEP,
        global_concurrency=1,
        polling_interval_sec=min(pace.sweep_seconds, _LONGEST_UPKEEP_SECONDS),
    )


def _call_sweeps(queue: Queue, engine: sa.Engine, worker: str, seconds: int) -> None:
    """Bring one sweep into the queue in each span of time, however many workers there are.

    The schedules of DBOS go by the host's clock: set back, they wait until it is as late again, and
    set forward they enqueue a sweep for each minute that there never was.
    """
    while True:
        try:
            with engine.begin() as connection:
                queue.submit_sweep(connection, seconds, thorough=False)
                queue.submit_sweep(connection, _HOUR_SECONDS, thorough=True)
        except Exception as failure:  # the next one does what this one would have done
            note(log, "no sweep was called for", failure, worker=worker)
        time.sleep(seconds)

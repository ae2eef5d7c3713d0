"""The worker process: takes jobs from the queue, says that it lives, takes dead workers' jobs over.

python -m service.workers.worker [PARENT] runs one with the settings of the environment; with a
PARENT it ends when that process does.
"""

from __future__ import annotations

import contextlib
import logging
import os
import signal
import sys
import threading
import uuid
from collections.abc import Callable, Iterable, Iterator
from functools import partial

import sqlalchemy as sa

import drivers
from service import counters, dbos_queue, logs, metrics, tracing, webhooks
from service.dbos_queue import Duties, Held, Pace
from service.errors import AbandonedError, DeadlineError, StartError
from service.opening import open_database, open_storage
from service.patience import note, passes
from service.problems import cause_of, problem_of
from service.retention import Sweep
from service.rows import attempts, cameras, database, heartbeats, jobs, waiting
from service.rows.states import State
from service.settings import Settings
from service.workers import capturing, host, presence, sandbox, scratch
from service.workers.attempt import Attempt
from service.workers.processes import die_with_parent

_OVERDUE_AT_ONCE = 100  # the rest can wait for the next heartbeat, which must not be late
_RETRY_SECONDS = 1.0  # between two looks at a job that another worker has
_AGAIN_SECONDS = 10.0  # between two looks for a worker that knows a job's options
_STOP_SECONDS = drivers.SWITCH_S + 5.0  # of captures, for their flash to be left off, too

log = logging.getLogger("service.workers.worker")


Claim = Callable[[sa.Connection, str, str], jobs.Job | None]
IsOver = Callable[[sa.Connection, jobs.Job], bool]


class Worker:
    """One worker; `run` is what the queue calls, `keep` what `serve` repeats."""

    def __init__(self, settings: Settings) -> None:
        """Open database and store. Raises StartError."""
        self.id = f"{host.name()}-{os.getpid()}-{uuid.uuid4().hex[:8]}"
        self._settings = settings
        self._engine = open_database(settings)
        self._storage = open_storage(settings)
        self._queue = dbos_queue.Queue(self._engine)
        self._deliverer = webhooks.Deliverer(self._engine, self._queue, settings)
        self._sweeping = Sweep(self._engine, self._storage, self._queue, settings)
        self._keep_seconds = settings.retention_seconds
        self._fork_server = sandbox.fork_server(settings.worker_concurrency, pairs=True)
        self._stopping = threading.Event()
        self._idle = threading.Condition()
        self._busy = 0
        self._runs: set[str] = set()
        """What the queues have called this worker for: see Held.work."""
        self._idle_held: set[Held] = set()
        """What the queues have given to this worker, without calling it yet."""

    def serve(self, stop: threading.Event) -> None:
        """Work until `stop` is set, then put back what is running. Raises StartError.

        The process is to end right after: threads of unfinished jobs never return.
        """
        metrics.serve(self._settings, self._engine)
        self._fork_server.start()
        scratch.clear(self._settings.data_dir)
        presence.enter(self._settings.data_dir, self.id)
        self._enter()
        self._launch()
        log.info("ready", extra={"worker": self.id})
        self.keep()
        while not stop.wait(self._settings.heartbeat_seconds):
            self.keep()
        self._stopping.set()
        with self._idle:
            self._idle.wait_for(lambda: self._busy == 0, timeout=_STOP_SECONDS)
        self._leave()
        log.info("stopped", extra={"worker": self.id})

    def _launch(self) -> None:
        duties = Duties(self.run, self.capture, self.deliver, self.sweep)
        settings = self._settings
        pace = Pace(settings.worker_concurrency, settings.poll_seconds, settings.sweep_seconds)
        try:
            dbos_queue.launch(self._engine, self.id, host.of_usb(self._engine), duties, pace)
        except sa.exc.DBAPIError as error:
            raise StartError(
                "The database of jobs went away while the worker started: start it, or check "
                f"LIGHTLAYERS_DATABASE_URL ({cause_of(error)})."
            ) from error

    def keep(self) -> None:
        """One heartbeat, jobs of dead workers back into the queue, and deliveries that are due."""
        try:
            self._beat()
            self._bury()
            held = self._queue.held()  # first: whoever holds something has beaten before
            with self._engine.begin() as connection:
                living = heartbeats.living(connection, self._settings.silence_seconds)
                dead = {one for one in held if one.worker not in living}
                lost = jobs.held(connection, {one.job for one in dead if one.runs})
            forgotten = self._forgotten(held)
            self._queue.put_back(dead | forgotten)
            # A worker that was stopped has put its jobs back itself, but for their queue's entries.
            taken = {one for one in dead if one.job in lost or not one.runs}
            for one in taken:
                log.warning("taken over", extra={"job": one.job, "worker": self.id})
                counters.TAKEOVERS.inc(one.runs)
            for one in forgotten | (dead - taken):
                log.warning("put back", extra={"job": one.job, "worker": self.id})
            self._fail_overdue()
            self._queue_deliveries()
        except Exception as error:  # the next heartbeat may find the database there again
            note(log, "the heartbeat was cut short", error, worker=self.id)
            self._make_room(error)

    def _enter(self) -> None:
        """Say for the first time that this worker lives. Raises StartError."""
        try:
            self._beat()
        except sa.exc.DBAPIError as error:
            self._make_room(error)  # for the next start
            raise StartError(
                "The database of jobs cannot be written: make room on its disk, or check "
                f"LIGHTLAYERS_DATABASE_URL ({cause_of(error)})."
            ) from error

    def _leave(self) -> None:
        try:
            with self._engine.begin() as connection:
                heartbeats.leave(connection, self.id)
            presence.leave(self._settings.data_dir, self.id)
        except Exception as error:  # others find out by the process's lock, or its silence
            note(log, "left without a word", error, worker=self.id)

    def _bury(self) -> None:
        """Forget the workers of this machine that have died."""
        for worker in presence.dead(self._settings.data_dir):
            with self._engine.begin() as connection:
                heartbeats.leave(connection, worker)

    def _forgotten(self, held: Iterable[Held]) -> set[Held]:
        """Find what this worker took out of the queues without learning of it.

        The database's answer got lost on the way.
        """
        with self._idle:
            idle = {one for one in held if one.worker == self.id and one.work not in self._runs}
        # What came out just now is called for in a moment.
        forgotten, self._idle_held = idle & self._idle_held, idle
        return forgotten

    def run(self, job_id: str, again: int = 0) -> None:
        """Run a job until it has ended, or is queued once more for a newer worker.

        That is for options that this worker does not know; after patience_seconds of the settings
        they fail the job. again: how often it was queued so. An attempt that is cut short is
        followed by another, and counts as lost unless what cut it short may pass, like a database
        that is away.
        """
        self._alone(job_id, lambda: self._run(job_id, attempts.claim, _has_ended, again))

    def capture(self, job_id: str) -> None:
        """Have the camera of a job take its pair. Returns only when it has, or the job has ended.

        The rest of the job waits in the queue of jobs then, and the camera is free.
        """
        queued = dbos_queue.capture_id(job_id)
        self._alone(queued, lambda: self._capture(job_id))

    def deliver(self, job_id: str, number: int) -> None:
        """Make the `number`th attempt at a job's delivery. Returns only when it is written."""
        queued = dbos_queue.delivery_id(job_id, number)
        self._alone(queued, lambda: self._deliverer.deliver(job_id, number))

    def sweep(self, queued: str, thorough: bool) -> None:
        """Remove what is due, or as much as can be; queued: id of the sweep in its queue."""
        self._alone(queued, lambda: self._sweep(thorough))

    def _alone(self, queued: str, work: Callable[[], object]) -> None:
        """Do an entry of a queue, never twice at a time; queued: its name by Held.work."""
        with self._idle:
            # A job that was taken over while this worker was frozen may come back to it.
            self._idle.wait_for(lambda: queued not in self._runs)
            self._runs.add(queued)
        try:
            work()
        finally:
            with self._idle:
                self._runs.remove(queued)
                self._idle.notify_all()

    def _capture(self, job_id: str) -> None:
        if not self._run(job_id, cameras.claim, self._is_passed_on):
            self._leave_flash_off(job_id)  # a worker that died with it on left nobody to do so

    def _leave_flash_off(self, job_id: str) -> None:
        """Switch off the flash for a job whose row is gone, unless another job has the switch."""
        switch = self._settings.flash_switch
        if switch is None:
            return
        with contextlib.suppress(*database.AWAY):
            with self._engine.connect() as connection:
                in_use = cameras.is_switch_in_use(connection, job_id)
            if not in_use:
                drivers.leave_flash_off(switch)

    def _is_passed_on(self, connection: sa.Connection, job: jobs.Job) -> bool:
        """Whether the camera's part of a job is done; the rest of it waits in its queue then."""
        over = cameras.is_past_capture(job)
        if over and job.state == State.QUEUED:
            # An attempt that was cut short once it had the pair has not passed it on.
            self._queue.submit(connection, job.id, job.rank)
        return over

    def _run(self, job_id: str, claim: Claim, is_over: IsOver, again: int = 0) -> bool:
        """Do what a queue has for a job, until it is over; whether there is such a job."""
        attempt: Attempt | None = None
        lost = hindered = False
        while True:
            try:
                with self._working():
                    if attempt:
                        attempt.give_up(lost)
                        attempt = None
                    with self._engine.begin() as connection:
                        held = claim(connection, job_id, self.id)
                        known = held or jobs.find(connection, job_id)
                        over = known is None or is_over(connection, known)
                    hindered = False
                    if over:
                        return known is not None
                    if held:
                        attempt, lost = self._start(held), False
                        passed_on = self._finish(held, attempt, again)
                        attempt = None
                        if passed_on:
                            return True
                        self._queue_deliveries()
                        continue
            except Exception as error:
                # Raised to the queue, it would end the job there and nowhere else.
                lost |= not passes(error)  # still so where writing that is hindered
                if not (hindered and passes(error)):  # one line, not one for each try
                    note(log, "cut short", error, job=job_id, worker=self.id)
                hindered = True
            # Another worker that lives has it: stay by, in case that it dies. Or its camera is in
            # use, which takes no longer.
            self._stopping.wait(_RETRY_SECONDS)

    @contextlib.contextmanager
    def _working(self) -> Iterator[None]:
        """Have a stop of the worker wait for the block; once it stops, the block never begins."""
        with self._idle:
            stopping = self._stopping.is_set()
            self._busy += not stopping
        if stopping:
            # A return would tell the queue that the job is done.
            threading.Event().wait()
        try:
            yield
        finally:
            with self._idle:
                self._busy -= 1
                self._idle.notify_all()

    def _queue_deliveries(self) -> None:
        with self._engine.begin() as connection:
            webhooks.queue_deliveries(connection, self._queue)

    def _start(self, job: jobs.Job) -> Attempt:
        return Attempt(
            job,
            self._engine,
            self._storage,
            self._settings,
            self._fork_server,
            self._stopping.is_set,
        )

    def _finish(self, job: jobs.Job, attempt: Attempt, again: int) -> bool:
        """Do what is left of a job; whether it was queued once more, for a newer worker."""
        ends = job.state == State.CANCELING or job.lost >= attempts.LOST_ATTEMPTS
        if ends and job.captures:  # the attempt before this one died, perhaps between photographs
            capturing.leave_flash_off(job, self._settings)
        if job.state == State.CANCELING:
            attempt.give_up()
        elif job.lost >= attempts.LOST_ATTEMPTS:
            log.warning("given up", extra={"job": job.id, "trace_id": job.trace_id})
            problem = problem_of(AbandonedError(job.lost), job.trace_id).model_dump()
            attempt.fail(problem)
        else:
            return self._work(job, attempt, again)
        return False

    def _work(self, job: jobs.Job, attempt: Attempt, again: int) -> bool:
        submit = partial(self._queue.submit, job_id=job.id, rank=job.rank)
        if job.captures:
            attempt.capture(submit)
            return False
        if again * _AGAIN_SECONDS >= self._settings.patience_seconds:
            return attempt.run()
        return attempt.run(partial(submit, again=again + 1, delay_seconds=_AGAIN_SECONDS))

    def _fail_overdue(self) -> None:
        """End jobs that wait past their deadlines; their attempts end those that run."""
        failed: dict[str, str] = {}
        with self._engine.begin() as connection:
            for job_id, trace_id in waiting.overdue(connection, _OVERDUE_AT_ONCE):
                problem = problem_of(DeadlineError(), trace_id)
                if jobs.fail_waiting(connection, job_id, problem.model_dump(), self._keep_seconds):
                    failed[job_id] = problem.type
        for job_id, problem_type in failed.items():
            log.info("failed: %s", problem_type, extra={"job": job_id})
        if failed:
            self._queue.withdraw(*failed)

    def _sweep(self, thorough: bool) -> None:
        try:
            self._sweeping.run(thorough)
        except Exception as error:  # the next one does what this one has left
            note(log, "the sweep was cut short", error, worker=self.id)
            self._make_room(error)

    def _make_room(self, error: Exception) -> None:
        """Remove files where an error is that of a database whose disk is full.

        No sweep would: on such a disk none can be taken out of its queue.
        """
        if not database.is_full(error):
            return
        try:
            self._sweeping.make_room()
        except Exception as failure:  # the next heartbeat tries again
            note(log, "making room was cut short", failure, worker=self.id)

    def _beat(self) -> None:
        with self._engine.begin() as connection:
            heartbeats.beat(connection, self.id)


def _has_ended(_connection: sa.Connection, job: jobs.Job) -> bool:
    return job.ended


def main() -> None:
    """Run a worker until SIGTERM or SIGINT."""
    if len(sys.argv) > 1:
        die_with_parent(int(sys.argv[1]))
    logs.configure()
    try:
        run_until_signal(Settings())
    except StartError as error:  # one line, as of everything else: `serve` tries again
        log.error("%s", error)
        sys.exit(2)


def run_until_signal(settings: Settings) -> None:
    """Run a worker in this process, which ends with it. Raises StartError."""
    tracing.configure("worker")
    worker = Worker(settings)
    stop = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda _number, _frame: stop.set())
    worker.serve(stop)
    tracing.flush()
    logging.shutdown()
    # Threads of jobs that were put back wait for ever; see Worker.run.
    os._exit(0)


if __name__ == "__main__":
    main()

"""The worker process: does what comes out of the queues, one attempt at a job after the other.

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
from collections.abc import Callable
from functools import partial

import sqlalchemy as sa

import drivers
from service import logs, metrics, tracing, webhooks
from service.dbos_queue.entries import capture_id, delivery_id
from service.dbos_queue.launch import Duties, Pace, launch
from service.dbos_queue.queue import Queue
from service.errors import AbandonedError, StartError
from service.opening import open_database, open_storage
from service.patience import note, passes
from service.problems import cause_of, problem_of
from service.rows import attempts, cameras, database, jobs
from service.rows.states import State
from service.settings import Settings
from service.workers import capturing, host, sandbox, scratch
from service.workers.attempt import Attempt
from service.workers.in_hand import InHand
from service.workers.means import Means
from service.workers.processes import die_with_parent
from service.workers.upkeep import Upkeep

_RETRY_SECONDS = 1.0  # between two looks at a job that another worker has
_AGAIN_SECONDS = 10.0  # between two looks for a worker that knows a job's options
_STOP_SECONDS = drivers.SWITCH_S + 5.0  # of captures, for their flash to be left off, too

log = logging.getLogger("service.workers.worker")


Claim = Callable[[sa.Connection, str, str], jobs.Job | None]
IsOver = Callable[[sa.Connection, jobs.Job], bool]


class Worker:
    """One worker; `run`, `capture`, `deliver` and `sweep` are what the queues call."""

    def __init__(self, settings: Settings) -> None:
        """Open database and store. Raises StartError."""
        self.id = f"{host.name()}-{os.getpid()}-{uuid.uuid4().hex[:8]}"
        self._settings = settings
        self._engine = open_database(settings)
        self._storage = open_storage(settings)
        self._queue = Queue(self._engine)
        self._deliverer = webhooks.Deliverer(self._engine, self._queue, settings)
        self._fork_server = sandbox.fork_server(settings.worker_concurrency, pairs=True)
        self._in_hand = InHand()
        self.upkeep = Upkeep(
            self.id, self._engine, self._storage, self._queue, settings, self._in_hand.entries
        )

    def serve(self, stop: threading.Event) -> None:
        """Work until `stop` is set, then put back what is running. Raises StartError.

        The process is to end right after: threads of unfinished jobs never return.
        """
        metrics.serve(self._settings, self._engine)
        self._fork_server.start()
        scratch.clear(self._settings.data_dir)
        self.upkeep.enter()
        self._launch()
        log.info("ready", extra={"worker": self.id})
        self.upkeep.keep()
        while not stop.wait(self._settings.heartbeat_seconds):
            self.upkeep.keep()
        self._in_hand.stop(_STOP_SECONDS)
        self.upkeep.leave()
        log.info("stopped", extra={"worker": self.id})

    def _launch(self) -> None:
        duties = Duties(self.run, self.capture, self.deliver, self.sweep)
        settings = self._settings
        pace = Pace(settings.worker_concurrency, settings.poll_seconds, settings.sweep_seconds)
        try:
            launch(self._engine, self.id, host.of_usb(self._engine), duties, pace)
        except sa.exc.DBAPIError as error:
            raise StartError(
                "The database of jobs went away while the worker started: start it, or check "
                f"LIGHTLAYERS_DATABASE_URL ({cause_of(error)})."
            ) from error

    def run(self, job_id: str, again: int = 0) -> None:
        """Run a job until it has ended, or is queued once more for a newer worker.

        That is for options that this worker does not know; after patience_seconds of the settings
        they fail the job. again: how often it was queued so. An attempt that is cut short is
        followed by another, and counts as lost unless what cut it short may pass, like a database
        that is away.
        """
        with self._in_hand.alone(job_id):
            self._run(job_id, attempts.claim, _has_ended, again)

    def capture(self, job_id: str) -> None:
        """Have the camera of a job take its pair. Returns only when it has, or the job has ended.

        The rest of the job waits in the queue of jobs then, and the camera is free.
        """
        with self._in_hand.alone(capture_id(job_id)):
            if not self._run(job_id, cameras.claim, self._is_passed_on):
                self._leave_flash_off(job_id)  # a worker that died with it on left nobody to do so

    def deliver(self, job_id: str, number: int) -> None:
        """Make the `number`th attempt at a job's delivery. Returns only when it is written."""
        with self._in_hand.alone(delivery_id(job_id, number)):
            self._deliverer.deliver(job_id, number)

    def sweep(self, queued: str, thorough: bool) -> None:
        """Remove what is due, or as much as can be; queued: id of the sweep in its queue."""
        with self._in_hand.alone(queued):
            self.upkeep.sweep(thorough)

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
                with self._in_hand.step():
                    if attempt:
                        attempt.outcome.give_up(lost)
                        attempt = None
                    held, known = self._claimed(job_id, claim, is_over)
                    hindered = False
                    if known is not None:
                        return known
                    if held:
                        attempt, lost = self._start(held), False
                        passed_on = self._finish(held, attempt, again)
                        attempt = None
                        if passed_on:
                            return True
                        self.upkeep.queue_deliveries()
                        continue
            except Exception as error:
                # Raised to the queue, it would end the job there and nowhere else.
                lost |= not passes(error)  # still so where writing that is hindered
                if not (hindered and passes(error)):  # one line, not one for each try
                    note(log, "cut short", error, job=job_id, worker=self.id)
                hindered = True
            # Another worker that lives has it: stay by, in case that it dies. Or its camera is in
            # use, which takes no longer.
            self._in_hand.pause(_RETRY_SECONDS)

    def _claimed(
        self, job_id: str, claim: Claim, is_over: IsOver
    ) -> tuple[jobs.Job | None, bool | None]:
        """Claim a job if it is to be had; and once it is over, whether there is such a job."""
        with self._engine.begin() as connection:
            held = claim(connection, job_id, self.id)
            job = held or jobs.find(connection, job_id)
            if job is None:
                return None, False
            return held, True if is_over(connection, job) else None

    def _start(self, job: jobs.Job) -> Attempt:
        ending = self._in_hand.is_stopping
        means = Means.of(job, self._engine, self._storage, self._settings, ending)
        return Attempt(means, self._fork_server)

    def _finish(self, job: jobs.Job, attempt: Attempt, again: int) -> bool:
        """Do what is left of a job; whether it was queued once more, for a newer worker."""
        ends = job.state == State.CANCELING or job.lost >= attempts.LOST_ATTEMPTS
        if ends and job.captures:  # the attempt before this one died, perhaps between photographs
            capturing.leave_flash_off(job, self._settings)
        if job.state == State.CANCELING:
            attempt.outcome.give_up()
        elif job.lost >= attempts.LOST_ATTEMPTS:
            log.warning("given up", extra={"job": job.id, "trace_id": job.trace_id})
            problem = problem_of(AbandonedError(job.lost), job.trace_id).model_dump()
            attempt.outcome.fail(problem)
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
    # Threads of jobs that were put back wait for ever; see InHand.step.
    os._exit(0)


if __name__ == "__main__":
    main()

"""The worker process: takes jobs from the queue, says that it lives, takes dead workers' jobs over.

python -m service.worker [PARENT] runs one with the settings of the environment; with a PARENT it
ends when that process does.
"""

from __future__ import annotations

import logging
import os
import signal
import socket
import sys
import threading
import uuid

import sqlalchemy as sa

from service import engine, jobs, logs, metrics, sandbox, scratch, tracing, webhooks
from service.attempt import Attempt
from service.errors import AbandonedError, problem_of
from service.opening import open_database, open_storage
from service.processes import die_with_parent
from service.settings import Settings
from service.states import State

_RETRY_SECONDS = 1.0
_STOP_SECONDS = 5.0

log = logging.getLogger("service.worker")


class Worker:
    """One worker; `run` is what the queue calls, `keep` what `serve` repeats."""

    def __init__(self, settings: Settings) -> None:
        """Open database and store. Raises StartError."""
        self.id = f"{socket.gethostname()[:32]}-{os.getpid()}-{uuid.uuid4().hex[:8]}"
        self._settings = settings
        self._engine = open_database(settings)
        self._storage = open_storage(settings)
        self._queue = engine.Queue(self._engine)
        self._teller = webhooks.Teller(self._engine, self._queue, settings)
        self._fork_server = sandbox.fork_server(settings.worker_concurrency)
        self._stopping = threading.Event()
        self._idle = threading.Condition()
        self._busy = 0

    def serve(self, stop: threading.Event) -> None:
        """Work until `stop` is set, then put back what is running. Raises StartError.

        The process is to end right after: threads of unfinished jobs never return.
        """
        metrics.serve(self._settings, self._engine)
        self._fork_server.start()
        scratch.clear(self._settings.data_dir)
        self._beat()
        engine.launch(
            self._engine,
            self.id,
            lambda job_id: self.run(job_id),
            lambda job_id, number: self._teller.tell(job_id, number),
            self._settings.worker_concurrency,
            self._settings.poll_seconds,
        )
        log.info("ready", extra={"worker": self.id})
        self.keep()
        while not stop.wait(self._settings.heartbeat_seconds):
            self.keep()
        self._stopping.set()
        with self._idle:
            self._idle.wait_for(lambda: self._busy == 0, timeout=_STOP_SECONDS)
        with self._engine.begin() as connection:
            jobs.leave(connection, self.id)
        log.info("stopped", extra={"worker": self.id})

    def keep(self) -> None:
        """One heartbeat, the jobs of dead workers back into the queue, and webhooks to be told."""
        try:
            self._beat()
            with self._engine.begin() as connection:
                living = jobs.living_workers(connection, self._settings.silence_seconds)
            for job_id in engine.take_over(living):
                log.warning("taken over", extra={"job": job_id, "worker": self.id})
                metrics.TAKEOVERS.inc()
            self._queue_news()
        except sa.exc.DBAPIError:
            log.exception("the database did not answer", extra={"worker": self.id})

    def run(self, job_id: str) -> None:
        """Run a job to its end. Returns only when the job has ended, however."""
        held: jobs.Job | None = None
        while True:
            if self._stopping.is_set():
                # A return would tell the queue that the job is done.
                threading.Event().wait()
            try:
                with self._engine.begin() as connection:
                    if held:
                        jobs.release(connection, held)
                    held = jobs.claim(connection, job_id, self.id)
                    known = held or jobs.find(connection, job_id)
                if known is None or known.ended:
                    return
                if held:
                    self._attempt(held)
                    held = None
                    self._queue_news()
                    continue
            except sa.exc.DBAPIError:
                log.exception("the database did not answer", extra={"job": job_id})
            # Another worker that lives has it: stay by, in case that it dies.
            self._stopping.wait(_RETRY_SECONDS)

    def _queue_news(self) -> None:
        with self._engine.begin() as connection:
            webhooks.queue_news(connection, self._queue)

    def _attempt(self, job: jobs.Job) -> None:
        with self._idle:
            self._busy += 1
        try:
            if job.state == State.CANCELING:
                with self._engine.begin() as connection:
                    jobs.acknowledge_cancel(connection, job)
            elif job.lost >= jobs.LOST_ATTEMPTS:
                reason = AbandonedError(
                    f"The job was given up because its worker died {job.lost} times while at it; "
                    "these photographs may be what kills it."
                )
                with self._engine.begin() as connection:
                    jobs.fail(connection, job, problem_of(reason, job.trace_id).model_dump())
            else:
                Attempt(
                    job,
                    self._engine,
                    self._storage,
                    self._settings,
                    self._fork_server,
                    self._stopping.is_set,
                ).run()
        finally:
            with self._idle:
                self._busy -= 1
                self._idle.notify_all()

    def _beat(self) -> None:
        with self._engine.begin() as connection:
            jobs.beat(connection, self.id)


def main() -> None:
    """Run a worker until SIGTERM or SIGINT."""
    if len(sys.argv) > 1:
        die_with_parent(int(sys.argv[1]))
    logs.configure()
    run_until_signal(Settings())


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

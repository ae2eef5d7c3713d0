"""One attempt at a job: photographs in, results out, and one write that makes them count."""

from __future__ import annotations

import contextlib
import json
import logging
import shutil
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import sqlalchemy as sa
from obstore.exceptions import BaseError

from pipeline.result_names import MANIFEST
from service import metrics, tracing
from service.durable import FULL
from service.errors import (
    AttemptError,
    NoProcessError,
    OlderWorkerError,
    StorageFullError,
)
from service.media import headers_of, media_type
from service.object_keys import captured_key, job_key, results_key
from service.patience import note, passes
from service.problems import problem_of
from service.rows import attempts, eta, jobs, kept
from service.rows.database import AWAY
from service.rows.states import State
from service.settings import Settings
from service.storage import Storage
from service.workers import capturing, materials, sandbox, scratch
from service.workers.deaths import DISK_IS_FULL
from service.workers.forkserver import ForkServer
from service.workers.means import Means
from service.workers.stages import Stages
from service.workers.stopping import Stopping
from service.workers.tasks import RESULTS, Kind, Limits, Task, results_of

_REPORT_SECONDS = 0.5  # between two writes of a fraction of one stage

PassOn = Callable[[sa.Connection], None]
"""Queues the rest of a job in the transaction that puts it back."""

log = logging.getLogger("service.workers.attempt")


class Attempt:
    """Runs one claimed job to its end, or until `ending` says that the worker ends."""

    def __init__(
        self,
        job: jobs.Job,
        engine: sa.Engine,
        storage: Storage,
        settings: Settings,
        fork_server: ForkServer,
        ending: Callable[[], bool],
    ) -> None:
        self._job = job
        self._engine = engine
        self._storage = storage
        self._settings = settings
        self._fork_server = fork_server
        kept_on = job.task == "calibrate" and job.options.get("setup")
        self._keep_seconds = None if kept_on else settings.retention_seconds
        self._stopping = Stopping(job, engine, ending, settings.silence_seconds)
        self._reported: tuple[str, float] = ("", 0.0)
        self._track: eta.Track
        self._stages = Stages()
        self._log = logging.LoggerAdapter(
            log, {"job": job.id, "attempt": job.attempt, "trace_id": job.trace_id}
        )
        self._means = Means(job, engine, storage, settings, self._stopping, self._log)

    def run(self, pass_on: PassOn | None = None) -> bool:
        """Run the job. However it ends is written to its row, unless the worker itself ends.

        pass_on: queues a job whose options only a newer worker knows; without it such a job fails.
        True where it was passed on. Whatever is raised has cut the attempt short, and give_up() is
        still to be called.
        """
        return self._trace(self._work, pass_on)

    def capture(self, pass_on: PassOn) -> None:
        """Have the camera take the pair, and put the job back for the rest, as run() does it."""
        self._trace(lambda: self._take(pass_on))

    def _trace(self, work: Callable[[], bool], pass_on: PassOn | None = None) -> bool:
        job = self._job
        attributes = {"job": job.id, "attempt": job.attempt, "task": job.task, "worker": job.worker}
        with tracing.attempt(job.trace_id, job.span_id, attributes):
            try:
                return self._run(work, pass_on)
            finally:
                self._stages.end()

    def _run(self, work: Callable[[], bool], pass_on: PassOn | None) -> bool:
        self._log.info("started")
        passed_on = False
        try:
            counts = work()
        except sandbox.StoppedError:
            counts = False
        except sandbox.TaskError as error:
            if pass_on and error.problem["type"] == problem_of(OlderWorkerError(""), "").type:
                self._log.warning("put back for a newer worker")
                counts = passed_on = self._put_back(pass_on)
            else:
                counts = self.fail(error.problem)
        except (*AWAY, ChildProcessError):  # another follows
            raise
        except Exception as error:
            if isinstance(error, FileNotFoundError) and self._stopping.is_void():
                counts = False  # its photographs were deleted with it
            else:
                counts = self.fail(self._problem_of(error))
        if not counts:
            self.give_up()
        return passed_on

    def _problem_of(self, error: Exception) -> dict[str, Any]:
        if isinstance(error, OSError) and error.errno in FULL:
            error = StorageFullError(DISK_IS_FULL)
        if not isinstance(error, AttemptError):  # a fault of ours, of the store or of the disk
            note(self._log, "failed", error)
            metrics.count_fault(error)
        return problem_of(error, self._job.trace_id).model_dump()

    def _take(self, pass_on: PassOn) -> bool:
        with capturing.flash_left_off(self._job, self._settings):
            self._begin()
            if not self._job.inputs:
                with contextlib.ExitStack() as stack:
                    directory = self._folder(stack)
                    run = partial(self._run_task, "capture", directory)
                    capturing.take_pair(self._means, directory, run)
        return self._put_back(pass_on)

    def _put_back(self, pass_on: PassOn) -> bool:
        def write() -> bool:
            with self._engine.begin() as connection:
                counts = attempts.release(connection, self._job)
                if counts:
                    pass_on(connection)
                return counts

        return self._means.patiently(write)

    def _begin(self) -> None:
        self._stopping.check()
        with self._engine.connect() as connection:
            self._track = eta.Track(eta.pace_of(connection, self._job))

    def _folder(self, stack: contextlib.ExitStack) -> Path:
        return self._means.patiently(
            lambda: stack.enter_context(scratch.folder(self._settings.data_dir))
        )

    def _work(self) -> bool:
        self._begin()
        with contextlib.ExitStack() as stack:
            directory = self._folder(stack)
            self._stages.enter("fetch")
            if self._job.task == "mix":
                materials.fetch_layers(self._means, directory)
            else:
                materials.fetch_pair(self._means, directory)
            if self._job.task == "separate":
                materials.bring_kept(self._means, directory)
            self._run_task(self._job.task, directory)
            if self._job.task == "calibrate":
                self._note_camera(directory)
            self._track.reach("store", 0.0)
            self._stages.enter("store")
            results = [self._store(path) for path in results_of(directory)]
        self._stages.end()
        counts = self._end(partial(attempts.succeed, stage_seconds=self._stages.seconds), results)
        if counts:
            self._log.info("succeeded")
            tracing.note("outcome", "succeeded")
        return counts

    def _clear_lost(self) -> None:
        """Delete what earlier attempts have left, which no quota counts: else it stays for ever."""
        # What is left of them here goes with the job.
        with contextlib.suppress(BaseError):
            for lost in range(1, self._job.attempt):
                self._storage.delete_below(results_key(self._job.id, lost))
                if self._job.capture and not self._job.has_pair_of(lost):
                    self._storage.delete_below(captured_key(self._job.id, lost))

    def _note_camera(self, directory: Path) -> None:
        manifest = json.loads((directory / RESULTS / MANIFEST).read_bytes())

        def write() -> None:
            with self._engine.begin() as connection:
                row = jobs.find(connection, self._job.id)
                if row and row.inputs:
                    inputs = kept.with_camera(row.inputs, manifest["taken_with"])
                    size, settings = row.stored_bytes, row.camera_settings
                    attempts.set_inputs(connection, self._job, inputs, size, settings)

        self._means.patiently(write)

    def _run_task(self, kind: Kind, directory: Path, ask: sandbox.Ask | None = None) -> Any:
        takes = kind == "capture"
        task = Task(
            kind=kind,
            job=self._job.id,
            trace_id=self._job.trace_id,
            directory=str(directory),
            limits=Limits.of(self._settings, self._settings.job_seconds),
            options=self._job.options,
            camera=capturing.pair_to_take(self._job, self._settings) if takes else None,
        )

        def run() -> Any:
            shutil.rmtree(directory / RESULTS, ignore_errors=True)
            stop, server = self._stopping.is_due, self._fork_server
            return sandbox.run(task, self._report, stop, server, ask)

        # A pair that was kept already must not be taken again over it.
        return self._means.patiently(run, _has_not_begun if takes else passes)

    def _store(self, path: Path) -> dict[str, Any]:
        self._stopping.check()
        key = results_key(self._job.id, self._job.attempt, path.name)
        return {
            "name": path.name,
            "size": path.stat().st_size,
            "sha256": self._means.keep(key, path, headers_of(path.name), self._stopping.check),
            "media_type": media_type(path.name),
        }

    def _report(self, stage: str, fraction: float) -> None:
        self._track.reach(stage, fraction)
        self._stages.enter(stage)
        last_stage, last_time = self._reported
        if stage == last_stage and time.monotonic() - last_time < _REPORT_SECONDS:
            return
        self._reported = (stage, time.monotonic())
        with contextlib.suppress(*AWAY), self._engine.begin() as connection:
            attempts.report(
                connection,
                self._job,
                stage,
                fraction,
                self._track.progress,
                self._track.seconds_left,
            )

    def fail(self, problem: dict[str, Any]) -> bool:
        """End the job with a problem; whether this counts."""
        counts = self._end(attempts.fail, problem)
        if counts:
            self._log.info("failed: %s", problem["type"])
            tracing.note("outcome", problem["type"])
            with contextlib.suppress(BaseError):  # what is left of them here goes with the job
                self._storage.delete_below(results_key(self._job.id, self._job.attempt))
        return counts

    def _end(self, end: Callable[..., bool], outcome: Any) -> bool:
        """Write the job's end, once the database is there; whether it counts."""

        def write() -> bool:
            with self._engine.begin() as connection:
                counts = end(connection, self._job, outcome, keep_seconds=self._keep_seconds)
                return counts or self._counted(connection)

        counts = self._means.patiently(write)
        if counts:
            self._clear_lost()
        return counts

    def _counted(self, connection: sa.Connection) -> bool:
        """Whether this attempt has ended the job already: the answer to that may have been lost."""
        row = jobs.find(connection, self._job.id)
        return (
            row is not None
            and row.attempt == self._job.attempt
            and row.state in (State.SUCCEEDED, State.FAILED)
        )

    def give_up(self, lost: bool = False) -> None:
        """End an attempt that was canceled, taken over, deleted, or put back by a worker's end.

        One that has ended the job stays as it is. lost: whether it counts as one that the job lost.
        Files of it that are not ours to delete stay: a worker tries again whatever is raised.
        """
        with self._engine.begin() as connection:
            canceled = attempts.acknowledge_cancel(connection, self._job, self._keep_seconds)
            if lost:  # either puts back what has not ended
                attempts.lose(connection, self._job)
            else:
                attempts.release(connection, self._job)
            row = jobs.find(connection, self._job.id)
        if canceled:
            self._log.info("canceled")
            tracing.note("outcome", "canceled")
        if row is None:
            self._clear(job_key(self._job.id))
        elif row.attempt != self._job.attempt or row.state != State.SUCCEEDED:
            self._clear(results_key(self._job.id, self._job.attempt))
            if self._job.capture and not row.has_pair_of(self._job.attempt):
                self._clear(captured_key(self._job.id, self._job.attempt))
            self._clear_lost()

    def _clear(self, prefix: str) -> None:
        if not self._storage.try_delete_below(prefix):
            self._log.warning("files of an attempt that does not count cannot be deleted")


def _has_not_begun(error: Exception) -> bool:
    return isinstance(error, NoProcessError)

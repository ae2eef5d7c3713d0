"""One attempt at a job: photographs in, results out, and one write that makes them count."""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

import sqlalchemy as sa

from pipeline.mix_files import LAYERS, MANIFEST
from service import eta, jobs, metrics, sandbox, scratch, tracing
from service.errors import AttemptError, LayersGoneError, problem_of
from service.forkserver import ForkServer
from service.media import media_type
from service.settings import Settings
from service.stages import Stages
from service.storage import Storage

FRAMES = ("no_flash", "flash")
_REPORT_SECONDS = 0.5
_ASK_SECONDS = 0.25

log = logging.getLogger("service.attempt")


def inputs_key(job_id: str, frame: str) -> str:
    """Where a job's photograph lies; frame is one of FRAMES."""
    return f"jobs/{job_id}/inputs/{frame}"


def results_key(job_id: str, attempt: int, name: str = "") -> str:
    """Where a result of an attempt lies; without a name, the prefix of all of them."""
    return f"jobs/{job_id}/{attempt}/{name}"


def describe_inputs(job_id: str, sha256: dict[str, str]) -> dict[str, Any]:
    """Make the `inputs` column for two photographs in the store, given their digests by frame."""
    return {frame: {"key": inputs_key(job_id, frame), "sha256": sha256[frame]} for frame in FRAMES}


class Attempt:
    """Runs one claimed job to its end, or until `stopping` says that the worker ends."""

    def __init__(
        self,
        job: jobs.Job,
        engine: sa.Engine,
        storage: Storage,
        settings: Settings,
        fork_server: ForkServer,
        stopping: Callable[[], bool],
    ) -> None:
        self._job = job
        self._engine = engine
        self._storage = storage
        self._settings = settings
        self._fork_server = fork_server
        self._stopping = stopping
        self._asked = 0.0
        self._stop = False
        self._reported: tuple[str, float] = ("", 0.0)
        self._track: eta.Track
        self._stages = Stages()
        self._log = logging.LoggerAdapter(
            log, {"job": job.id, "attempt": job.attempt, "trace_id": job.trace_id}
        )

    def run(self) -> None:
        """Do it. Every end but that of the worker is written to the job's row.

        Raises sqlalchemy.exc.DBAPIError when the database is away.
        """
        job = self._job
        attributes = {"job": job.id, "attempt": job.attempt, "task": job.task, "worker": job.worker}
        with tracing.attempt(job.trace_id, job.span_id, attributes):
            try:
                self._run()
            finally:
                self._stages.end()

    def _run(self) -> None:
        self._log.info("started")
        try:
            counts = self._work()
        except sandbox.StoppedError:
            counts = False
        except sandbox.TaskError as error:
            counts = self._fail(error.problem)
        except sa.exc.DBAPIError:
            raise
        except Exception as error:
            if not isinstance(error, AttemptError):  # a fault of ours, of the store or of the disk
                self._log.exception("failed")
                metrics.count_fault(error)
            counts = self._fail(problem_of(error, self._job.trace_id).model_dump())
        if not counts:
            self._give_up()

    def _work(self) -> bool:
        with self._engine.connect() as connection:
            self._track = eta.Track(eta.pace_of(connection, self._job))
        with scratch.folder(self._settings.data_dir) as directory:
            if self._job.capture and not self._job.inputs:
                self._capture(directory)
            elif self._job.task == "mix":
                self._fetch_layers(directory)
            else:
                self._stages.enter("fetch")
                for frame in FRAMES:
                    self._storage.get_file(inputs_key(self._job.id, frame), directory / frame)
            self._run_task(self._job.task, directory)
            self._track.reach("store", 0.0)
            self._stages.enter("store")
            results = [self._store(path) for path in sandbox.results_of(directory)]
        with self._engine.begin() as connection:
            counts = jobs.succeed(connection, self._job, results, self._track.finish())
        if counts:
            self._log.info("succeeded")
            tracing.note("outcome", "succeeded")
            for lost in range(1, self._job.attempt):
                self._storage.delete_below(results_key(self._job.id, lost))
        return counts

    def _capture(self, directory: Path) -> None:
        self._run_task("capture", directory)
        digests = {
            frame: self._storage.put_file(inputs_key(self._job.id, frame), directory / frame)
            for frame in FRAMES
        }
        size = sum((directory / frame).stat().st_size for frame in FRAMES)
        with self._engine.begin() as connection:
            jobs.set_inputs(connection, self._job, describe_inputs(self._job.id, digests), size)

    def _fetch_layers(self, directory: Path) -> None:
        self._stages.enter("fetch")
        with self._engine.connect() as connection:
            source = jobs.find(connection, self._job.options["of"])
        try:
            if source is None:
                raise FileNotFoundError
            for name in (LAYERS, MANIFEST):
                key = results_key(source.id, source.attempt, name)
                self._storage.get_file(key, directory / name)
        except FileNotFoundError as error:
            raise LayersGoneError(
                "The job whose layers were to be mixed has been deleted; separate the pair anew."
            ) from error

    def _run_task(
        self, kind: Literal["separate", "calibrate", "mix", "capture"], directory: Path
    ) -> None:
        task = sandbox.Task(
            kind=kind,
            job=self._job.id,
            trace_id=self._job.trace_id,
            directory=str(directory),
            memory_bytes=self._settings.job_memory_bytes,
            cpu_seconds=int(self._settings.job_seconds * (os.cpu_count() or 1)) + 1,
            options=self._job.options,
            capture=self._job.capture,
        )
        sandbox.run(
            task, self._settings.job_seconds, self._report, self._must_stop, self._fork_server
        )

    def _store(self, path: Path) -> dict[str, Any]:
        key = results_key(self._job.id, self._job.attempt, path.name)
        return {
            "name": path.name,
            "size": path.stat().st_size,
            "sha256": self._storage.put_file(key, path),
            "media_type": media_type(path.name),
        }

    def _report(self, stage: str, fraction: float) -> None:
        self._track.reach(stage, fraction)
        self._stages.enter(stage)
        last_stage, last_time = self._reported
        if stage == last_stage and time.monotonic() - last_time < _REPORT_SECONDS:
            return
        self._reported = (stage, time.monotonic())
        with self._engine.begin() as connection:
            jobs.report(
                connection,
                self._job,
                stage,
                fraction,
                self._track.progress,
                self._track.seconds_left,
            )

    def _must_stop(self) -> bool:
        if self._stopping():
            return True
        if time.monotonic() - self._asked > _ASK_SECONDS:
            self._asked = time.monotonic()
            with self._engine.connect() as connection:
                self._stop = jobs.must_stop(connection, self._job)
        return self._stop

    def _fail(self, problem: dict[str, Any]) -> bool:
        self._log.info("failed: %s", problem["type"])
        tracing.note("outcome", problem["type"])
        with self._engine.begin() as connection:
            return jobs.fail(connection, self._job, problem)

    def _give_up(self) -> None:
        """End an attempt that was canceled, taken over, deleted, or put back by a worker's end."""
        with self._engine.begin() as connection:
            if jobs.acknowledge_cancel(connection, self._job):
                self._log.info("canceled")
                tracing.note("outcome", "canceled")
            else:
                jobs.release(connection, self._job)
            gone = jobs.find(connection, self._job.id) is None
        below = f"jobs/{self._job.id}/" if gone else results_key(self._job.id, self._job.attempt)
        self._storage.delete_below(below)

"""One attempt at a job: photographs in, results out."""

from __future__ import annotations

import contextlib
import json
import shutil
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

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
from service.object_keys import results_key
from service.patience import note, passes
from service.problems import problem_of
from service.rows import attempts, eta, jobs, kept
from service.rows.database import AWAY
from service.workers import capturing, materials, sandbox, scratch
from service.workers.deaths import DISK_IS_FULL
from service.workers.forkserver import ForkServer
from service.workers.means import Means
from service.workers.outcome import Outcome, PassOn
from service.workers.stages import Stages
from service.workers.tasks import RESULTS, Kind, Limits, Task, results_of

_REPORT_SECONDS = 0.5  # between two writes of a fraction of one stage


class Attempt:
    """Runs one claimed job to its end, or until its worker ends."""

    def __init__(self, means: Means, fork_server: ForkServer) -> None:
        self._means, self._job = means, means.job
        self._fork_server = fork_server
        self._reported: tuple[str, float] = ("", 0.0)
        self._track: eta.Track
        self._stages = Stages()
        self.outcome = Outcome(means)

    def run(self, pass_on: PassOn | None = None) -> bool:
        """Run the job. However it ends is written to its row, unless the worker itself ends.

        pass_on: queues a job whose options only a newer worker knows; without it such a job fails.
        True where it was passed on. Whatever is raised has cut the attempt short, and its
        outcome is still to be given up.
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
        self._means.log.info("started")
        passed_on = False
        try:
            counts = work()
        except sandbox.StoppedError:
            counts = False
        except sandbox.TaskError as error:
            if pass_on and error.problem["type"] == problem_of(OlderWorkerError(""), "").type:
                self._means.log.warning("put back for a newer worker")
                counts = passed_on = self.outcome.put_back(pass_on)
            else:
                counts = self.outcome.fail(error.problem)
        except (*AWAY, ChildProcessError):  # another follows
            raise
        except Exception as error:
            if isinstance(error, FileNotFoundError) and self._means.stopping.is_void():
                counts = False  # its photographs were deleted with it
            else:
                counts = self.outcome.fail(self._problem_of(error))
        if not counts:
            self.outcome.give_up()
        return passed_on

    def _problem_of(self, error: Exception) -> dict[str, Any]:
        if isinstance(error, OSError) and error.errno in FULL:
            error = StorageFullError(DISK_IS_FULL)
        if not isinstance(error, AttemptError):  # a fault of ours, of the store or of the disk
            note(self._means.log, "failed", error)
            metrics.count_fault(error)
        return problem_of(error, self._job.trace_id).model_dump()

    def _take(self, pass_on: PassOn) -> bool:
        with capturing.flash_left_off(self._job, self._means.settings):
            self._begin()
            if not self._job.inputs:
                with contextlib.ExitStack() as stack:
                    directory = self._folder(stack)
                    run = partial(self._run_task, "capture", directory)
                    capturing.take_pair(self._means, directory, run)
        return self.outcome.put_back(pass_on)

    def _begin(self) -> None:
        self._means.stopping.check()
        with self._means.engine.connect() as connection:
            self._track = eta.Track(eta.pace_of(connection, self._job))

    def _folder(self, stack: contextlib.ExitStack) -> Path:
        return self._means.patiently(
            lambda: stack.enter_context(scratch.folder(self._means.settings.data_dir))
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
        return self.outcome.succeed(results, self._stages.seconds)

    def _note_camera(self, directory: Path) -> None:
        manifest = json.loads((directory / RESULTS / MANIFEST).read_bytes())

        def write() -> None:
            with self._means.engine.begin() as connection:
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
            limits=Limits.of(self._means.settings, self._means.settings.job_seconds),
            options=self._job.options,
            camera=capturing.pair_to_take(self._job, self._means.settings) if takes else None,
        )

        def run() -> Any:
            shutil.rmtree(directory / RESULTS, ignore_errors=True)
            stop, server = self._means.stopping.is_due, self._fork_server
            return sandbox.run(task, self._report, stop, server, ask)

        # A pair that was kept already must not be taken again over it.
        return self._means.patiently(run, _has_not_begun if takes else passes)

    def _store(self, path: Path) -> dict[str, Any]:
        check = self._means.stopping.check
        check()
        key = results_key(self._job.id, self._job.attempt, path.name)
        return {
            "name": path.name,
            "size": path.stat().st_size,
            "sha256": self._means.keep(key, path, headers_of(path.name), check),
            "media_type": media_type(path.name),
        }

    def _report(self, stage: str, fraction: float) -> None:
        self._track.reach(stage, fraction)
        self._stages.enter(stage)
        last_stage, last_time = self._reported
        if stage == last_stage and time.monotonic() - last_time < _REPORT_SECONDS:
            return
        self._reported = (stage, time.monotonic())
        with contextlib.suppress(*AWAY), self._means.engine.begin() as connection:
            attempts.report(
                connection,
                self._job,
                stage,
                fraction,
                self._track.progress,
                self._track.seconds_left,
            )


def _has_not_begun(error: Exception) -> bool:
    return isinstance(error, NoProcessError)

"""What operators do with jobs of all owners, straight on database and queue."""

from __future__ import annotations

import contextlib
import uuid
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import sqlalchemy as sa
from pydantic import BaseModel

from service import allowed, steering
from service.capture import Capture
from service.copy_pair import copy_pair
from service.dbos_queue.queue import Queue
from service.errors import (
    ForbiddenError,
    NotReadyError,
    QuotaError,
    StoredQuotaError,
    UnknownJobError,
)
from service.job_options import check_options
from service.mixing import MixOptions, check_mix
from service.object_keys import job_key
from service.opening import open_database, open_storage
from service.room import check_room
from service.rows import cameras, jobs, keys
from service.rows.states import State
from service.sentences import in_words
from service.settings import Settings
from service.storage.base import Storage

_RETRIED = (State.FAILED, State.CANCELED)


@dataclass(frozen=True)
class OperatorActions:
    """The parts of a service that its operator works on."""

    engine: sa.Engine
    queue: Queue
    settings: Settings

    def newest(self, state: State | None, limit: int) -> list[jobs.Job]:
        """Up to `limit` jobs, newest first; state: those in it only."""
        with self.engine.connect() as connection:
            return jobs.page(connection, None, limit, state=state)

    def find(self, job_id: str) -> jobs.Job:
        """Find a job. Raises UnknownJobError."""
        with self.engine.connect() as connection:
            return _known(jobs.find(connection, job_id), job_id)

    def cancel(self, job_id: str) -> State:
        """Stop a job; its state then. Raises UnknownJobError."""
        self.find(job_id)
        steering.cancel(self.engine, self.queue, self.settings, job_id)
        return self.find(job_id).state

    def retry(self, job_id: str) -> str:
        """Make a job like this one, which has failed or was canceled; the id of the new one.

        It is checked as a new one. Raises UnknownJobError, NotReadyError, GoneError for photographs
        or layers that are removed, OptionError for options, a webhook or a flash that it cannot
        have any more, what check_mix raises of the job that a mix is of, ForeignCameraError for
        such a camera, ForbiddenError for a webhook or a camera of a key that is not good any more,
        QueueFullError, StorageFullError, QuotaError and StoredQuotaError where there is no room for
        it, and StartError or BaseError while the store is away.
        """
        job = self.find(job_id)
        if job.state not in _RETRIED:
            raise NotReadyError(
                f"The job is {job.state}; one that is failed or canceled can be made anew."
            )
        self._check_reach(job)
        # Opened here alone: where the store is away, the jobs can be looked at all the same.
        storage = open_storage(self.settings)
        check_room(self.engine, self.settings, storage, job.owner)
        row = _row_like(job, self._checked_options(storage, job))
        untaken = {"capture": job.capture, "camera": job.camera}
        row |= copy_pair(storage, job, row["id"]) if job.inputs else untaken
        try:
            self._commit(row)
        except (QuotaError, StoredQuotaError):
            storage.delete_below(job_key(row["id"]))
            raise
        return str(row["id"])

    def _checked_options(self, storage: Storage, job: jobs.Job) -> BaseModel:
        """Read a job's options as those of a new one. Raises what retry says of them."""
        options = check_options(job.task, job.options)
        if isinstance(options, MixOptions):
            check_mix(storage, self.find(options.of), options.mix)
        return options

    def _commit(self, row: dict[str, Any]) -> None:
        """Commit a job's row and its entry in the queue: its camera's, while it has no pair."""
        with self.engine.begin() as connection:
            rank = jobs.add(connection, row)
            if "inputs" in row or row["camera"] is None:
                self.queue.submit(connection, row["id"], rank)
            else:
                on = cameras.host_of(connection, row["camera"])
                self.queue.submit_capture(connection, row["id"], rank, row["camera"], on)

    def _check_reach(self, job: jobs.Job) -> None:
        """Refuse what a job like this one reaches for, a webhook or a camera, if it may no more."""
        untaken = None if job.inputs else job.capture
        allowed.check_webhook(self.settings, job.webhook["url"] if job.webhook else None)
        if untaken is not None:
            with in_words():
                asked = Capture.model_validate(untaken)
            allowed.check_camera(self.settings, asked.camera)
            allowed.check_flash(self.settings, asked.flash)
        if job.webhook is None and untaken is None:
            return
        with self.engine.connect() as connection:
            ended = keys.has_ended(connection, job.owner)
        if ended:
            what = "have its webhook told" if untaken is None else "use its camera"
            raise ForbiddenError(
                f"The key that made the job is revoked or expired, so none like it may {what}; "
                "make one with a key that is good."
            )

    def confirm(self, job_id: str) -> None:
        """Say that what a job asks for is done.

        Raises UnknownJobError, NotReadyError, EndedError.
        """
        with self.engine.begin() as connection:
            steering.confirm(connection, _known(jobs.find(connection, job_id), job_id))


@contextlib.contextmanager
def open_actions(settings: Settings) -> Iterator[OperatorActions]:
    """Open the parts for as long as the block. Raises StartError."""
    with contextlib.ExitStack() as stack:
        engine = open_database(settings)
        stack.callback(engine.dispose)
        queue = Queue(engine)
        stack.callback(queue.close)
        yield OperatorActions(engine, queue, settings)


def _row_like(job: jobs.Job, options: BaseModel) -> dict[str, Any]:
    """Make the row of a new job like this one, all but its pair."""
    return {
        "id": uuid.uuid4().hex,
        "owner": job.owner,
        "priority": job.priority,
        "options": options.model_dump(mode="json", exclude_unset=True),
        "likeness": job.likeness,
        "webhook": job.webhook,
        "trace_id": uuid.uuid4().hex,
        "request_hash": job.request_hash,
    }


def _known(job: jobs.Job | None, job_id: str) -> jobs.Job:
    if job is None:
        raise UnknownJobError(job_id)
    return job

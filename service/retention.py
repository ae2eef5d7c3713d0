"""Removes jobs and uploads that are kept no longer, and stored files that belong to none."""

from __future__ import annotations

import itertools
import logging
import time

import sqlalchemy as sa

from service import belonging, upload_pieces
from service.dbos_queue.queue import Queue
from service.object_keys import JOBS, job_key
from service.rows import cameras, expiry, jobs
from service.settings import Settings
from service.storage.base import Storage

_BATCH = 500  # jobs in a transaction or statement
_QUEUE_SECONDS = 3600.0  # that the queue remembers what is done, for whoever looks into it
_STRAY_SECONDS = 86400.0
"""Longer than any request stores files before it commits their job."""

log = logging.getLogger("service.retention")


class Sweep:
    """Does again what an earlier sweep did not come to; any number of them may run at once."""

    def __init__(
        self, engine: sa.Engine, storage: Storage, queue: Queue, settings: Settings
    ) -> None:
        self._engine = engine
        self._storage = storage
        self._queue = queue
        self._settings = settings

    def run(self, thorough: bool) -> None:
        """Remove what is due.

        thorough: also remove expired uploads, and look through the store for files without a job,
        which stay where the store is another database's.
        A job whose files cannot be deleted stays, and keeps no other from going.
        Raises sqlalchemy.exc.DBAPIError or obstore.exceptions.BaseError when one is away.
        """
        self._queue.forget_done(_QUEUE_SECONDS)
        self._limit_keeping()
        self._remove_due()
        if thorough:
            self._look_through()
            with self._engine.begin() as connection:
                cameras.forget_unused(connection)

    def make_room(self) -> None:
        """Remove files, and no rows, of what is due: for a full disk that takes no row's change.

        The rows go with the next sweep; until then whoever asks for the files is told that they
        are gone. Removes as many as a heartbeat has time for. Raises what run raises.
        """
        if self._storage.free_bytes() is None:  # on no disk that a database could be on
            return
        with self._engine.connect() as connection:
            due = expiry.due(connection)
        stored = sorted(due.intersection(self._storage.folders(JOBS)))
        gone = (job_id for job_id in stored if self._delete_files(job_id))
        for job_id in itertools.islice(gone, _BATCH):
            log.info("files removed", extra={"job": job_id})
        self._look_through()

    def _limit_keeping(self) -> None:
        keep_seconds = self._settings.retention_seconds
        while keep_seconds is not None:
            with self._engine.begin() as connection:
                if not expiry.limit_keeping(connection, keep_seconds, _BATCH):
                    return

    def _remove_due(self) -> None:
        stuck: set[str] = set()
        while True:
            with self._engine.begin() as connection:
                found = set(expiry.expire(connection, _BATCH + len(stuck))) - stuck
            if not found:
                return
            for job_id in found:
                if not self._delete_files(job_id):
                    stuck.add(job_id)
                    continue
                with self._engine.begin() as connection:
                    expiry.remove(connection, job_id)
                log.info("removed", extra={"job": job_id})

    def _delete_files(self, job_id: str) -> bool:
        deleted = self._storage.try_delete_below(job_key(job_id))
        if not deleted:
            log.warning(
                "the files cannot be deleted: %s", upload_pieces.ADVICE, extra={"job": job_id}
            )
        return deleted

    def _look_through(self) -> None:
        ours = belonging.claim(self._engine, self._storage)
        if ours:
            self._remove_strays()
        upload_pieces.remove_expired(self._engine, self._storage, strays=ours)

    def _remove_strays(self) -> None:
        stored = self._storage.folders(JOBS)
        for start in range(0, len(stored), _BATCH):
            some = stored[start : start + _BATCH]
            with self._engine.connect() as connection:
                strays = set(some) - jobs.known(connection, some)
            for job_id in strays:
                changed = self._storage.changed(job_key(job_id))
                if changed < time.time() - _STRAY_SECONDS and self._delete_files(job_id):
                    log.info("files without a job removed", extra={"job": job_id})


def remove(engine: sa.Engine, storage: Storage, job_id: str) -> None:
    """Remove a job for good. The row goes last, so that a removal cut short is done again."""
    storage.delete_below(job_key(job_id))
    with engine.begin() as connection:
        expiry.remove(connection, job_id)

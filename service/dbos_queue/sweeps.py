"""The thread of a worker that calls for sweeps."""

from __future__ import annotations

import logging
import time

import sqlalchemy as sa

from service.dbos_queue.queue import Queue
from service.patience import note

_HOUR_SECONDS = 3600

log = logging.getLogger("service.dbos_queue")


def call_sweeps(queue: Queue, engine: sa.Engine, worker: str, seconds: int) -> None:
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

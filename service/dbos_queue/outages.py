"""What DBOS says of a database that is away, in lines that are few and bear no statement."""

from __future__ import annotations

import logging
import sys
import threading
import time

import psycopg
import sqlalchemy as sa

from service.problems import DATABASE_AWAY, cause_of
from service.rows.database import AWAY

_HINDERED = (sa.exc.DBAPIError, psycopg.Error, *AWAY)  # it waits for notifications by itself
_OUTAGE_SECONDS = 10.0  # between two lines on what hinders the queue


def silence_dbos() -> None:
    """Have DBOS write to no console: it does so unless its logger has a handler."""
    logging.getLogger("dbos").addHandler(logging.NullHandler())


def shorten_outages(worker: str) -> None:
    """Have DBOS write to the log of this process, which is a worker's, and be brief there."""
    silence_dbos()
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

"""Does a thing again for as long as what hinders it may pass.

A store that is away, a full disk, a machine that is out of processes.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from typing import TypeVar

from obstore.exceptions import BaseError

from pipeline.errors import reason_of
from service import metrics
from service.durable import FULL
from service.errors import NoProcessError, StorageFullError
from service.problems import cause_of, kind_of
from service.rows.database import AWAY

_FIRST_PAUSE_SECONDS = 0.5
_LONGEST_PAUSE_SECONDS = 15.0

Result = TypeVar("Result")
Log = logging.Logger | logging.LoggerAdapter[logging.Logger]


def passes(error: Exception) -> bool:
    """Whether an error may be over in a moment, through no doing of ours."""
    if isinstance(error, OSError):
        return error.errno in FULL
    return isinstance(error, (BaseError, StorageFullError, NoProcessError, *AWAY))


def note(log: Log, what: str, error: Exception, **of: str) -> None:
    """Log a line for what may pass, like a database that is away, and a trace for anything else.

    what: was hindered. of: fields of the line.
    """
    if passes(error):
        cause = reason_of(error) if isinstance(error, OSError) else cause_of(error)
        log.error("%s, %s: %s", what, kind_of(error).name, cause, extra=of)
    else:
        log.error("%s", what, exc_info=error, extra=of)


def patiently(
    work: Callable[[], Result],
    seconds: float,
    pause: Callable[[float], None],
    log: Log,
    may_pass: Callable[[Exception], bool] = passes,
) -> Result:
    """Do it until it works, ever more seldom, for so many seconds; then raise what hinders it.

    pause: waits for so many seconds, and raises what is to end the waiting before. may_pass: tells
    what is waited for; anything else is raised at once.
    """
    deadline = time.monotonic() + seconds
    wait = _FIRST_PAUSE_SECONDS
    while True:
        try:
            return work()
        except Exception as error:
            if not may_pass(error) or time.monotonic() + wait > deadline:
                raise
            metrics.count_fault(error)
            log.warning("hindered, tries again in %s s: %s", wait, _reason(error))
        pause(wait)
        wait = min(2 * wait, _LONGEST_PAUSE_SECONDS)


def _reason(error: Exception) -> str:
    if isinstance(error, OSError):
        return reason_of(error)
    return f"{kind_of(error).name}: {cause_of(error)}"

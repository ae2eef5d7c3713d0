from __future__ import annotations

import errno
import logging
import sqlite3
from collections.abc import Callable
from types import SimpleNamespace

import pytest
import sqlalchemy as sa
from obstore.exceptions import GenericError

from service import counters
from service.errors import CrashError, NoProcessError, StorageFullError
from service.patience import passes, patiently

log = logging.getLogger("test")


def _failing(times: int, error: Exception) -> Callable[[], str]:
    left = [error] * times

    def work() -> str:
        if left:
            raise left.pop()
        return "done"

    return work


def test_what_passes_is_waited_for_ever_longer() -> None:
    waited: list[float] = []
    done = patiently(_failing(7, GenericError("away")), 300, waited.append, log)
    assert done == "done"
    assert waited == [0.5, 1, 2, 4, 8, 15, 15]


@pytest.mark.parametrize(
    ("error", "words", "counted"),
    [
        (GenericError("away\n\nDebug source"), "store-unavailable: away", 2),
        (StorageFullError("It is full."), "storage-full: It is full", 0),
        (OSError(errno.ENOSPC, "No space left on device", "name"), "no space left on device", 0),
    ],
)
def test_what_hinders_is_named_and_the_stores_faults_are_counted(
    error: Exception, words: str, counted: int, caplog: pytest.LogCaptureFixture
) -> None:
    before = counters.STORE_ERRORS._value.get()
    patiently(_failing(2, error), 300, lambda _seconds: None, log)
    said = [one.getMessage() for one in caplog.records]
    assert said == [f"hindered, tries again in {wait} s: {words}" for wait in (0.5, 1.0)]
    assert counters.STORE_ERRORS._value.get() - before == counted


@pytest.mark.parametrize(
    ("seconds", "waits"), [(0, []), (7.4, [0.5, 1, 2]), (7.5, [0.5, 1, 2, 4]), (10, [0.5, 1, 2, 4])]
)
def test_it_is_waited_for_no_longer_than_that(
    seconds: float, waits: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    waited: list[float] = []
    clock = SimpleNamespace(monotonic=lambda: 1000.0 + sum(waited))
    monkeypatch.setattr("service.patience.time", clock)
    with pytest.raises(GenericError, match="away"):
        patiently(_failing(7, GenericError("away")), seconds, waited.append, log)
    assert waited == waits


def test_what_does_not_pass_is_raised_at_once() -> None:
    waited: list[float] = []
    with pytest.raises(CrashError):
        patiently(_failing(1, CrashError("It crashed.")), 300, waited.append, log)
    assert waited == []


def test_what_may_pass_can_be_told() -> None:
    def may_pass(error: Exception) -> bool:
        return isinstance(error, KeyError)

    waited: list[float] = []
    assert patiently(_failing(2, KeyError()), 300, waited.append, log, may_pass) == "done"
    with pytest.raises(GenericError):
        patiently(_failing(1, GenericError("away")), 300, waited.append, log, may_pass)
    assert waited == [0.5, 1]


def test_waiting_may_be_ended() -> None:
    def stop(_seconds: float) -> None:
        raise KeyError("stopped")

    with pytest.raises(KeyError):
        patiently(_failing(1, GenericError("away")), 300, stop, log)


@pytest.mark.parametrize(
    ("error", "may_pass"),
    [
        (GenericError("no answer"), True),
        (StorageFullError("full"), True),
        (NoProcessError(), True),
        (BlockingIOError(errno.EAGAIN, "of something else"), False),
        (OSError(errno.ENOSPC, "full"), True),
        (sa.exc.OperationalError("SELECT 1", None, sqlite3.OperationalError("full")), True),
        (sa.exc.InterfaceError("SELECT 1", None, sqlite3.InterfaceError("gone")), True),
        (sa.exc.TimeoutError("all connections are in use"), True),
        (FileNotFoundError(errno.ENOENT, "no such photograph"), False),
        (ChildProcessError("no fork server"), False),
        (sa.exc.IntegrityError("INSERT", None, sqlite3.IntegrityError("twice")), False),
        (ValueError("a fault of ours"), False),
    ],
)
def test_what_may_pass(error: Exception, may_pass: bool) -> None:
    assert passes(error) is may_pass

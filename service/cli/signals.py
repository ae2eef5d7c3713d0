"""What ends a command from outside: Ctrl-C, a service manager, a terminal that is closed."""

from __future__ import annotations

import signal
import sys
from types import FrameType

_ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

_received: list[int] = []


def install() -> None:
    """Have these signals raise, so that what is half written goes; ignored ones stay ignored."""
    for number in _ENDING:
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, _raise)


def leave_hangup() -> None:
    """Have SIGHUP end a service at once, as if nothing were installed; ignored, it stays so.

    Services handle the other signals themselves, and their threads do not end by an exception.
    """
    if signal.getsignal(signal.SIGHUP) is _raise:
        signal.signal(signal.SIGHUP, signal.SIG_DFL)


def exit_code() -> int | None:
    """128 and the number of the first signal that came, None before.

    Compiled loops make a SystemError of what is raised in them: exceptions alone do not tell.
    """
    return 128 + _received[0] if _received else None


def _raise(number: int, _frame: FrameType | None) -> None:
    _received.append(number)
    if number == signal.SIGINT:
        raise KeyboardInterrupt
    sys.exit(128 + number)

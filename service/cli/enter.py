"""Presses of Enter, each read by itself: what is read ahead of its question is lost to select()."""

from __future__ import annotations

import fcntl
import os
import select
import sys
import termios
import time


def await_enter(timeout_s: float | None = None) -> bool:
    """Wait for a line on stdin; whether one came, within so many seconds and before its end."""
    stdin, line = sys.stdin.fileno(), b""
    while not line.endswith(b"\n"):
        ready, _, _ = select.select([stdin], [], [], timeout_s)
        if not ready:
            return False
        if not (read := os.read(stdin, 1)):
            break
        line += read
    return bool(line)


def pause(seconds: float) -> None:
    """Let so many seconds pass, in which Enter is not asked for. Raises EOFError at stdin's end.

    What is typed on a terminal meanwhile is dropped; lines of a program wait for their question,
    and the end comes after them.
    """
    stdin, until = sys.stdin.fileno(), time.monotonic() + seconds
    while (left := until - time.monotonic()) > 0:
        if not select.select([stdin], [], [], left)[0]:
            return
        typed = sys.stdin.isatty()
        if not os.read(stdin, 1024) if typed else _has_ended(stdin):
            raise EOFError
        if not typed:  # else the line that waits would have it look again at once
            time.sleep(max(0.0, until - time.monotonic()))


def _has_ended(readable: int) -> bool:
    """Whether nothing is left of what can be read at once; false where the system cannot tell."""
    try:
        left = fcntl.ioctl(readable, termios.FIONREAD, bytes(4))
    except OSError:  # like /dev/null, which takes no such question
        return False
    return not any(left)


def forget_typed() -> None:
    """Drop what was typed on a terminal before it is asked for; a program's lines all count."""
    if sys.stdin.isatty():
        termios.tcflush(sys.stdin, termios.TCIFLUSH)

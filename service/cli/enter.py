"""Presses of Enter, each read by itself: what is read ahead of its question is lost to select()."""

from __future__ import annotations

import os
import select
import sys
import termios


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


def forget_typed() -> None:
    """Drop what was typed on a terminal before it is asked for; a program's lines all count."""
    if sys.stdin.isatty():
        termios.tcflush(sys.stdin, termios.TCIFLUSH)

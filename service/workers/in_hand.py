"""What a worker has in hand at this moment, in whichever of its threads."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Iterator


class InHand:
    """The entries of queues that it works on, in steps that a stop of the worker waits for."""

    def __init__(self) -> None:
        """Begin with none."""
        self._entries: set[str] = set()
        self._steps = 0
        self._stopping = threading.Event()
        self._changed = threading.Condition()

    def entries(self) -> set[str]:
        """Name the entries that are worked on, as Held.work does."""
        with self._changed:
            return set(self._entries)

    @contextlib.contextmanager
    def alone(self, entry: str) -> Iterator[None]:
        """Work on an entry in the block, never twice at a time: a second one waits for the first.

        A job that was taken over while the worker was frozen may come back to it.
        """
        with self._changed:
            self._changed.wait_for(lambda: entry not in self._entries)
            self._entries.add(entry)
        try:
            yield
        finally:
            with self._changed:
                self._entries.remove(entry)
                self._changed.notify_all()

    @contextlib.contextmanager
    def step(self) -> Iterator[None]:
        """Have a stop wait for the block; once the worker stops, the block never begins."""
        with self._changed:
            stopping = self._stopping.is_set()
            self._steps += not stopping
        if stopping:
            # A return would tell the queue that the job is done.
            threading.Event().wait()
        try:
            yield
        finally:
            with self._changed:
                self._steps -= 1
                self._changed.notify_all()

    def is_stopping(self) -> bool:
        """Whether the worker stops."""
        return self._stopping.is_set()

    def pause(self, seconds: float) -> None:
        """Let so many seconds pass between two steps, or fewer where the worker stops."""
        self._stopping.wait(seconds)

    def stop(self, seconds: float) -> None:
        """Let no step begin any more, and wait for those that have, for so long at most."""
        self._stopping.set()
        with self._changed:
            self._changed.wait_for(lambda: self._steps == 0, timeout=seconds)

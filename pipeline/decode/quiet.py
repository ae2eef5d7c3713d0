"""Native decoders write their own lines to the terminal; the sentence to people is ours."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager

_LOCK = threading.Lock()


@contextmanager
def muted() -> Iterator[None]:
    """Send the process's standard output and error nowhere meanwhile; one thread at a time."""
    with _LOCK, open(os.devnull, "wb") as nowhere:  # noqa: PTH123  a device, not a file
        kept = [(number, os.dup(number)) for number in (1, 2)]
        try:
            for number, _ in kept:
                os.dup2(nowhere.fileno(), number)
            yield
        finally:
            for number, copy in kept:
                os.dup2(copy, number)
                os.close(copy)

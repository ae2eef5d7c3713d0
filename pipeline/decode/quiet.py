"""Decoders write their own lines to the terminal; the sentence to people is ours."""

from __future__ import annotations

import io
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout

_LOCK = threading.Lock()
_STDERR = 2


@contextmanager
def muted() -> Iterator[None]:
    """Drop meanwhile what C writes to standard error and Python prints; one thread at a time.

    It holds for the whole process, so only for the short time of a decoder's run.
    """
    with _LOCK, open(os.devnull, "wb") as nowhere:  # noqa: PTH123  a device, not a file
        kept = os.dup(_STDERR)
        try:
            os.dup2(nowhere.fileno(), _STDERR)
            with redirect_stdout(io.StringIO()):  # OpenEXR's Python layer prints warnings
                yield
        finally:
            os.dup2(kept, _STDERR)
            os.close(kept)

"""Loading the modules that separate, which are many."""

from __future__ import annotations

import contextlib
import gc
from collections.abc import Iterator


@contextlib.contextmanager
def loading() -> Iterator[None]:
    """While modules are loaded look for no garbage: there is none, and all would be gone through.

    What is there at the end is not gone through later either.
    """
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()

"""Lazy access to colour-science, whose import takes seconds and warns of optional parts."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any


def colour_science() -> Any:
    """Import `colour` on first use, without its warnings of optional packages."""
    with without_warnings():
        import colour

    return colour


@contextmanager
def without_warnings() -> Iterator[None]:
    """Call into colour-science without its runtime and usage warnings."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield

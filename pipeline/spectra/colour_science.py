"""Lazy access to colour-science, whose import takes seconds and warns of optional parts."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any, cast


@cache
def colour_science() -> Any:
    """Import `colour` on first use, without its warnings of optional packages.

    Without matplotlib, too, where that is installed: two thirds of the time, for nothing.
    """
    with without_warnings(), _hidden("matplotlib"):
        import colour

    return colour


@contextmanager
def without_warnings() -> Iterator[None]:
    """Call into colour-science without its runtime and usage warnings."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


@contextmanager
def _hidden(package: str) -> Iterator[None]:
    """Have a package that has not been imported yet pass for missing meanwhile."""
    if package in sys.modules:
        yield
        return
    modules = cast("dict[str, Any]", sys.modules)
    before = set(modules)
    modules[package] = None
    try:
        yield
    finally:
        # imported only here: it imports asyncio
        from unittest.mock import NonCallableMock

        # colour puts mocks where the package would be
        for name in modules.keys() - before:
            if modules[name] is None or isinstance(modules[name], NonCallableMock):
                del modules[name]

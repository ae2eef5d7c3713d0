"""What fails once."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


def at_first(error: Exception, work: Callable[..., Any]) -> Callable[..., Any]:
    """Raise an error once, and then work."""
    errors = [error]

    def fail_once(*arguments: Any, **named: Any) -> Any:
        if errors:
            raise errors.pop()
        return work(*arguments, **named)

    return fail_once

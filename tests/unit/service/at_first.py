"""What fails, once or always."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


def raising(error: BaseException) -> Callable[..., Any]:
    """Raise an error whenever it is called."""

    def fail(*_arguments: object, **_named: object) -> Any:
        raise error

    return fail


def at_first(error: Exception, work: Callable[..., Any]) -> Callable[..., Any]:
    """Raise an error once, and then work."""
    errors = [error]

    def fail_once(*arguments: Any, **named: Any) -> Any:
        if errors:
            raise errors.pop()
        return work(*arguments, **named)

    return fail_once

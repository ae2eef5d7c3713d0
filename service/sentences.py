"""Sentences for people about values that cannot be used.

A module of its own, since commands start quickly that import this alone.
"""

from __future__ import annotations

from pydantic import ValidationError


def sentence_of(error: ValidationError) -> str:
    """Tell the first fault that pydantic found in one sentence that names the place."""
    fault = error.errors(include_url=False, include_context=False, include_input=False)[0]
    unknown = fault["type"] == "extra_forbidden"
    return describe_fault(fault["loc"], "this name is not known" if unknown else fault["msg"])


def describe_fault(location: tuple[int | str, ...], message: str) -> str:
    """One sentence for a place in the request and what is wrong there."""
    message = message.removeprefix("Value error, ").rstrip(".")
    place = ".".join(str(part) for part in location)
    return f"{place}: {message}." if place else f"{message[:1].upper()}{message[1:]}."

"""Sentences for people about values that cannot be used.

A module of its own, since commands start quickly that import this alone.
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from pydantic import ValidationError

from pipeline.errors import OptionError, own_words

_BRANCH = re.compile(r"(constrained-)?(bool|int|float|str)|[a-z-]*\[.*\]")
"""What pydantic adds to a place where a value may be of several kinds, or is a name itself."""

_KIND_OF_LAMP = re.compile(r"(?<=_lamps\.)(\d+)\.(area|table|name)\b")
"""What pydantic adds to a known lamp, which may be of several kinds."""

_MEMBER = re.compile(r"\b(lamp|pinned_lamp|forbidden_lamp|light_direction)s\.(\d{1,9})(\.|$)")
_NUMBER = re.compile(r"\b(direction|rgb|chart)\.(\d{1,9})$")
"""Places in lists that people count, from 1 on."""

_LONGEST_NAME = 80
"""Characters of a name that are told: somebody may have written any."""

_WORDS = (
    (r" or instance of \w+$| after validation| or object to extract fields from$", ""),
    (r"\bvalid dictionary\b", "valid object"),
    (r"\bvalid tuple\b", "valid list"),
    (r"^Tuple\b", "List"),
    (r"^Dictionary\b", "The object"),
)
"""Python's words, and those of people who write JSON."""


@contextlib.contextmanager
def in_words(whole: str = "") -> Iterator[None]:
    """Raise OptionError, with the sentence, where pydantic refuses what is read in the block.

    whole: what that is, to be named where the fault is of all of it.
    """
    try:
        yield
    except ValidationError as error:
        raise OptionError(sentence_of(error, whole)) from error


def sentence_of(error: ValidationError, whole: str = "") -> str:
    """Tell the first fault that pydantic found in one sentence that names the place, or whole."""
    return sentence_of_faults(error.errors(include_url=False, include_input=False), whole)


def sentence_of_faults(faults: Sequence[Mapping[str, Any]], whole: str = "") -> str:
    """Tell the first of pydantic's faults, not empty, in one sentence that names the place.

    A value that may be of several kinds has a fault as each: those farthest within it are told.
    """
    first = _place(faults[0])
    same = [fault for fault in faults if _place(fault)[: len(first)] == first]
    told = same if len(faults[0]["loc"]) > len(first) else same[:1]
    place = max(map(_place, told), key=len)
    shown = place or ((whole,) if whole else ())
    messages = dict.fromkeys(_message(fault) for fault in told if _place(fault) == place)
    start, *others = messages
    *more, last = [start, *(other.removeprefix("Input should be ") for other in others)]
    return describe_fault(shown, f"{', '.join(more)} or {last}" if more else last)


def _place(fault: Mapping[str, Any]) -> tuple[int | str, ...]:
    location: tuple[int | str, ...] = tuple(fault["loc"])
    if fault["type"] == "json_invalid":
        return ()
    own = 1 if fault["type"] == "extra_forbidden" else 0  # the last part is what somebody wrote
    within, written = location[: len(location) - own], location[len(location) - own :]
    return (*(part for part in within if not _BRANCH.fullmatch(str(part))), *written)


def _message(fault: Mapping[str, Any]) -> str:
    message: str = fault["msg"]
    if fault["type"] == "union_tag_not_found":
        return f"Field {fault['ctx']['discriminator']} required"
    if fault["type"] == "union_tag_invalid":
        return f"{fault['ctx']['discriminator']} should be one of {fault['ctx']['expected_tags']}"
    if fault["type"] == "extra_forbidden":
        return "this name is not known"
    if fault["type"] == "json_invalid":
        return f"Invalid JSON: {fault['ctx']['error']}"
    if fault["loc"][-1:] == ("[key]",):
        return message.replace("Input", "this name is not known; it", 1)
    for pattern, word in _WORDS:
        message = re.sub(pattern, word, message)
    return message


def describe_fault(location: tuple[int | str, ...], message: str) -> str:
    """One sentence for a place in the request and what is wrong there."""
    message = own_words(message).rstrip(".")
    place = _in_words(location)
    return f"{place}: {message}." if place else f"{message[:1].upper()}{message[1:]}."


def _in_words(location: tuple[int | str, ...]) -> str:
    place = _KIND_OF_LAMP.sub(r"\1", ".".join(_shortened(str(part)) for part in location))
    place = _NUMBER.sub(lambda found: f"{found[1]}, number {int(found[2]) + 1}", place)
    return _MEMBER.sub(
        lambda found: f"{found[1].replace('_', ' ')} {int(found[2]) + 1}{', ' if found[3] else ''}",
        place,
    )


def _shortened(name: str) -> str:
    return name if len(name) <= _LONGEST_NAME else f"{name[:_LONGEST_NAME]}…"

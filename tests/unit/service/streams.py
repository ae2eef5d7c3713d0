"""Reads server-sent events."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any, NamedTuple

import httpx


class Event(NamedTuple):
    """One event, or a comment when it has no data."""

    id: str | None
    name: str
    data: Any
    comment: str | None = None


def events(answer: httpx.Response) -> Iterator[Event]:
    """Read the events of a stream until it ends."""
    assert answer.status_code == 200
    assert answer.headers["content-type"].startswith("text/event-stream")
    fields: dict[str, str] = {}
    for line in answer.iter_lines():
        if line:
            name, _, value = line.partition(":")
            fields[name or "comment"] = value.removeprefix(" ")
            continue
        if "data" in fields:
            name = fields.get("event", "message")
            yield Event(fields.get("id"), name, json.loads(fields["data"]))
        elif "comment" in fields:
            yield Event(None, "", None, fields["comment"])
        fields = {}

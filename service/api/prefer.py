"""The Prefer header (RFC 7240), of which `wait` is honoured, and `no-redirect` by results."""

from __future__ import annotations

import re
from typing import Annotated

from fastapi import Depends, Header, Response
from pydantic import WithJsonSchema

WAIT_SECONDS = 60
"""The longest that `Prefer: wait=N` waits."""

_WORD = r"[!#$%&'*+.^_`|~0-9A-Za-z-]+"
_QUOTED = r'"(?:[^"\\]|\\.)*"'
# a quotation that nobody ends goes to the end: looked for from each quote, 30 kB took seconds
_PART = re.compile(r'(?:"(?:[^"\\]|\\.?)*(?:"|$)|[^,"])+')
_PREFERENCE = re.compile(rf"\s*({_WORD})(?:\s*=\s*({_WORD}|{_QUOTED}))?\s*(?:;.*)?", re.DOTALL)


def preferences(headers: list[str]) -> dict[str, str]:
    """Read Prefer headers: values by name in lower case, "" for a name alone.

    Of a name given twice the first counts; what is malformed is ignored, as the RFC asks.
    """
    found: dict[str, str] = {}
    for part in _PART.findall(",".join(headers)):
        match = _PREFERENCE.fullmatch(part)
        if match:
            value = match[2] or ""
            if value.startswith('"'):
                value = re.sub(r"\\(.)", r"\1", value[1:-1])
            found.setdefault(match[1].lower(), value)
    return found


def _wait(
    response: Response,
    prefer: Annotated[
        list[str] | None,
        WithJsonSchema({"type": "string"}),  # as the RFC has it: a list, but with commas
        Header(
            description=f"wait=N: answer when the job ends, after N (≤ {WAIT_SECONDS}) s at most."
        ),
    ] = None,
) -> int:
    wait = preferences(prefer or []).get("wait", "")
    if not re.fullmatch(r"[0-9]{1,9}", wait):
        return 0
    seconds = min(int(wait), WAIT_SECONDS)
    response.headers["Preference-Applied"] = f"wait={seconds}"
    return seconds


Wait = Annotated[int, Depends(_wait)]
"""Seconds that the caller prefers to wait for the end of a job; says in the answer that it does."""

APPLIED = {
    "Preference-Applied": {
        "description": "wait=N, when the request asked for it: how long it may have waited.",
        "schema": {"type": "string"},
    }
}
"""The header of such an answer in the OpenAPI document."""

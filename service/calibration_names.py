"""Options that name a calibration in place of a table, which only the service can look up."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pipeline.taken_with import Kind

KINDS: dict[str, Kind] = {
    "camera": "camera",
    "response": "camera",
    "flash_spectrum": "flash",
    "neutral": "flash",
    "light_directions": "lamps",
}
"""Options that a calibration may fill in, and of which kind it must be."""

_STAND_INS: dict[Kind, Any] = {
    "camera": "",
    "flash": "",
    "lamps": [{"direction": [0, 0, 1]}] * 3,  # as many as may be, so that no pinned one is amiss
}
"""What passes for the find of a calibration until it is looked up."""


def take_out(options: Any) -> tuple[Any, dict[str, Any]]:
    """Put stand-ins where options name calibrations; the options then, and what stood there.

    options: as sent.
    """
    if not isinstance(options, dict):
        return options, {}
    named = {name: value for name, value in options.items() if names_calibration(name, value)}
    return options | {name: _STAND_INS[KINDS[name]] for name in named}, named


def names_calibration(option: str, value: Any) -> bool:
    """Whether the value of an option, as sent, is a calibration's name."""
    if option not in KINDS or not isinstance(value, Mapping) or set(value) != {"calibration"}:
        return False
    return not isinstance(value["calibration"], (Mapping, list))  # however deep they go

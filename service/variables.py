"""Whether the environment's LIGHTLAYERS_ variables are settings, or somebody mistyped one."""

from __future__ import annotations

import difflib
import os

from service.settings import Settings

PREFIX = "LIGHTLAYERS_"
_NOT_SETTINGS = ("LIGHTLAYERS_SPECTRA", "LIGHTLAYERS_MAX_PIXELS", "LIGHTLAYERS_KEY")
"""Variables that are read elsewhere."""


def mistyped() -> list[str]:
    """One sentence for each variable that nothing reads: its name, never its value, and advice."""
    known = [PREFIX + name.upper() for name in Settings.model_fields] + [*_NOT_SETTINGS]
    strange = sorted(name for name in os.environ if name.startswith(PREFIX) and name not in known)
    return [f"{name} is no setting; {_advice(name, known)}" for name in strange]


def _advice(name: str, known: list[str]) -> str:
    endings = [each.removeprefix(PREFIX) for each in known]
    near = difflib.get_close_matches(name.removeprefix(PREFIX), endings, 1)
    return f"did you mean {PREFIX}{near[0]}?" if near else "take it out."

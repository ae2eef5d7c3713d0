"""What is wrong with the environment's LIGHTLAYERS_ variables that no setting's check tells."""

from __future__ import annotations

import difflib
import os

from pipeline.errors import OptionError
from pipeline.images.max_pixels import max_pixels
from pipeline.spectra.folder import names_are_known
from service.settings import Settings

PREFIX = "LIGHTLAYERS_"
_NOT_SETTINGS = ("LIGHTLAYERS_SPECTRA", "LIGHTLAYERS_MAX_PIXELS", "LIGHTLAYERS_KEY")
"""Variables that are read elsewhere."""


def faults() -> list[str]:
    """One sentence for each that nothing reads, without its value, or that fails jobs."""
    known = [PREFIX + name.upper() for name in Settings.model_fields] + [*_NOT_SETTINGS]
    strange = sorted(name for name in os.environ if name.startswith(PREFIX) and name not in known)
    sentences = [f"{name} is no setting; {_advice(name, known)}" for name in strange]
    if not names_are_known():
        sentences.append(
            "LIGHTLAYERS_SPECTRA names no folder of this host, so that a worker here fails each "
            "separation: set it to one with spectra."
        )
    try:
        max_pixels()
    except OptionError as error:
        sentences.append(str(error))
    return sentences


def _advice(name: str, known: list[str]) -> str:
    endings = [each.removeprefix(PREFIX) for each in known]
    near = difflib.get_close_matches(name.removeprefix(PREFIX), endings, 1)
    return f"did you mean {PREFIX}{near[0]}?" if near else "take it out."

"""Looks at a set-up as its processes would find it, and says what is wrong and what to do."""

from __future__ import annotations

import importlib.metadata
import platform
from collections.abc import Iterator

from pydantic import ValidationError

from service.doctor import database, machine, ports, store
from service.doctor.finding import Finding
from service.sentences import sentence_of
from service.settings import Settings
from service.variables import PREFIX, faults

_LIBRARIES = ("lightlayers", "dbos", "fastapi", "numpy", "obstore", "opencv-python-headless")
_LOOKS = (
    machine.look_at_folder,
    database.look,
    store.look,
    machine.look_at_disk,
    machine.look_at_memory,
    machine.look_at_open_files,
    machine.look_at_kernels,
    ports.look,
)
"""At each part of a set-up, in this order."""


def examine() -> Iterator[Finding]:
    """Look at everything, one finding after the other."""
    yield _versions()
    yield from _variables()
    try:
        settings = Settings()
    except ValidationError as error:
        yield Finding("wrong", "settings", sentence_of(error))
        return
    for look in _LOOKS:
        yield from look(settings)


def _versions() -> Finding:
    numbers = ", ".join(f"{name} {importlib.metadata.version(name)}" for name in _LIBRARIES)
    return Finding("ok", "versions", f"{numbers}, Python {platform.python_version()}.")


def _variables() -> Iterator[Finding]:
    sentences = faults()
    for sentence in sentences:
        yield Finding("wrong", "variables", sentence)
    if not sentences:
        yield Finding("ok", "variables", f"every {PREFIX}… variable is a setting.")

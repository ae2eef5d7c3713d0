"""What people are told of a command that failed."""

from __future__ import annotations

import traceback
from pathlib import Path

from pipeline.errors import InputError
from service.durable import FULL
from service.workers.shortage import TOO_LITTLE_MEMORY, wants_memory

_FULL = "A disk is full that this writes to, that of what is printed perhaps: make room on it."


def explain(error: Exception) -> tuple[str, int]:
    """One sentence for what went wrong, and the exit code: 2 where the user can mend it, else 1."""
    if wants_memory(error):
        return TOO_LITTLE_MEMORY, 1
    if isinstance(error, InputError):
        return str(error), 2
    if getattr(error, "errno", None) in FULL:
        return _FULL, 1
    # Imported only here: they take time, and memory that may be short.
    from pydantic import ValidationError

    from drivers import BadAddressError, CameraNotFoundError, DriverError
    from service.errors import ServiceError
    from service.problems import DATABASE_AWAY, DATABASE_FULL, STORE_AWAY, kind_of
    from service.sending.failures import RefusedError, ServiceAwayError
    from service.sentences import sentence_of

    if isinstance(error, BadAddressError | CameraNotFoundError | RefusedError | ServiceError):
        return str(error), 2
    if (kind := kind_of(error)) in (DATABASE_AWAY, DATABASE_FULL, STORE_AWAY):
        return str(kind.detail), 1
    if isinstance(error, DriverError | ServiceAwayError):
        return str(error), 1
    if isinstance(error, ValidationError):  # of the settings: options were refused by their command
        name, colon, rest = sentence_of(error).partition(":")
        return f"LIGHTLAYERS_{name.upper()}{colon}{rest}", 2
    *_, place = traceback.extract_tb(error.__traceback__)
    return (
        f"Something broke inside lightlayers, please report it: {type(error).__name__} in "
        f"{Path(place.filename).name}, line {place.lineno}: {' '.join(str(error).split())}",
        1,
    )

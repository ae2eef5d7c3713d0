"""What the doctor says of one part."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Finding:
    """What was found of one part; "note" is worth knowing and stops nothing."""

    grade: Literal["ok", "note", "wrong"]
    part: str
    sentence: str

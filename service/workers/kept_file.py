"""The file by which an attempt hands kept calibrations to the process of its task."""

from __future__ import annotations

import json
from pathlib import Path

from pipeline.calibration.kept_calibrations import Kept

_FILE = "kept.json"


def write(directory: Path, kept: list[Kept]) -> None:
    """Lay calibrations beside the photographs of a job, for its process."""
    if kept:
        text = json.dumps([one.model_dump() for one in kept])
        (directory / _FILE).write_text(text, encoding="utf-8")


def read(directory: Path) -> list[Kept]:
    """Read what write has laid there."""
    path = directory / _FILE
    if not path.exists():
        return []
    return [Kept.model_validate(one) for one in json.loads(path.read_bytes())]

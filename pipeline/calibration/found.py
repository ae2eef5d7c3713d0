"""What a calibration found, before it is written."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pipeline.calibration.options import Corners
from pipeline.options import Circle
from pipeline.run_warnings import RunWarning


@dataclass(frozen=True)
class Found:
    """What a calibration found.

    file: what the option of a separation reads. said: what people want to know of it. marks: a
    picture of where it was read. warnings: what to trust less.
    """

    file: bytes
    said: dict[str, Any]
    marks: bytes
    warnings: list[RunWarning]


def said_of_marks(chart: Corners | None, circle: Circle | None) -> dict[str, Any]:
    """Where a chart or else a card was read, in pixels, for the manifest."""
    if chart is not None:
        return {"chart": [[round(x, 2), round(y, 2)] for x, y in chart]}
    assert circle is not None
    return {"card": {name: round(v, 2) for name, v in circle.model_dump().items()}}

"""Numbers with commas between them, as marks in photographs are typed."""

from __future__ import annotations

from collections.abc import Sequence


def read_numbers(text: str) -> list[float] | None:
    """Read numbers with commas between them; None for what is no such list."""
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        return None


def circle(numbers: Sequence[float]) -> dict[str, float]:
    """Name the three numbers of X,Y,RADIUS. Raises ValueError where there are not three."""
    return dict(zip(("x", "y", "radius"), numbers, strict=True))


def lamps_asked_for(text: str) -> int | str:
    """Read a number of lamps; what is none, like auto, stays as it is, and so do endless digits."""
    # of more than 4,300 Python makes no number
    return int(text) if text.isdecimal() and len(text) < 10 else text

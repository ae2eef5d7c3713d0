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

"""What the files of this package have in common."""

from __future__ import annotations

from typing import Any, Protocol


class Writer(Protocol):
    """What takes a picture some rows at a time, from top to bottom."""

    def write(self, rows: Any, /) -> None:
        """Take the next rows; of which shape and range says the file."""

    def close(self) -> None:
        """Complete the file."""

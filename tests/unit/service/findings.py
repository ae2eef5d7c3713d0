"""What the doctor finds."""

from __future__ import annotations

from collections.abc import Callable

from service.doctor.finding import Finding

Look = Callable[[], dict[str, Finding]]
"""Gives what was found of each part, the last one where there are several."""

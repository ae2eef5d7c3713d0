"""The photographs of a pair, by the names that requests, the store and the spool have for them."""

from __future__ import annotations

FRAMES = ("no_flash", "flash")

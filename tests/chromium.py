"""The browser of tests and measurements of the page."""

from __future__ import annotations

import shutil

# the first draws no window, and takes half of the processor time
_PROGRAMS = ("chromium-headless-shell", "chromium", "chromium-browser")


def find_chromium() -> str | None:
    """Path of a Chromium that is installed, None where there is none."""
    return next(filter(None, map(shutil.which, _PROGRAMS)), None)

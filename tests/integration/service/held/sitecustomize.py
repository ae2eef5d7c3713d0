"""Holds separations in their middle for as long as the file HELD_BY is there.

Python imports it at its start, where its folder is in PYTHONPATH.
"""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

if "service.workers.child" in sys.orig_argv and "HELD_BY" in os.environ:
    from pipeline.progress import Progress

    _gate = Path(os.environ["HELD_BY"])
    _report = Progress.report

    def _held_report(self: Progress, stage: str, fraction: float) -> None:
        _report(self, stage, fraction)
        while stage == "lamps" and _gate.exists():
            time.sleep(0.05)
            _report(self, stage, fraction)

    Progress.report = _held_report  # type: ignore[method-assign]

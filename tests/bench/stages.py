"""One job in this process: python -m tests.bench.stages NO_FLASH FLASH LIGHTS FILE.

Writes CPU seconds of every stage as JSON.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from itertools import pairwise
from pathlib import Path

from pipeline.options import Options
from pipeline.process import separate_files
from pipeline.progress import Progress


def main() -> None:
    """Separate the pair; imports are the time until here."""
    marks = [("imports", 0.0), ("decode", time.process_time())]

    def note(stage: str, _fraction: float) -> None:
        marks.append((stage, time.process_time()))

    no_flash, flash = (Path(path).read_bytes() for path in sys.argv[1:3])
    options = Options.model_validate({"lights": int(sys.argv[3])})
    with tempfile.TemporaryDirectory() as folder:
        separate_files(no_flash, flash, options, Path(folder), Progress(note))
    note("", 0.0)
    seconds: dict[str, float] = {}
    for (stage, start), (_, end) in pairwise(marks):
        seconds[stage] = seconds.get(stage, 0.0) + end - start
    Path(sys.argv[4]).write_text(json.dumps(seconds))


if __name__ == "__main__":
    main()

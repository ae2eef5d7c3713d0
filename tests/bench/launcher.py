"""Runs a command and says what it cost: a process of its own, because it is small.

The kernel counts what the parent holds when it starts a child as the child's memory.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time


def main() -> None:
    """A command as JSON on stdin; on stdout CPU and wall seconds, MiB, exit code, last words."""
    with tempfile.TemporaryFile() as said:
        start = time.monotonic()
        process = subprocess.Popen(json.load(sys.stdin), stdout=subprocess.DEVNULL, stderr=said)
        _, status, used = os.wait4(process.pid, 0)
        wall = time.monotonic() - start
        process.returncode = os.waitstatus_to_exitcode(status)
        said.seek(0)
        last_words = said.read().decode(errors="replace")
    result = {
        "cpu_s": used.ru_utime + used.ru_stime,
        "wall_s": wall,
        "peak_mb": used.ru_maxrss / 1024,
        "code": process.returncode,
        "said": last_words,
    }
    json.dump(result, sys.stdout)


if __name__ == "__main__":
    main()

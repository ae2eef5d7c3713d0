"""Runs commands at once and says what each cost: a process of its own, because it is small.

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
    """Commands as JSON on stdin; on stdout CPU and wall seconds, MiB, exit codes, last words."""
    start = time.monotonic()
    started = []
    for command in json.load(sys.stdin):
        said = tempfile.TemporaryFile()  # noqa: SIM115  closed when all have ended
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=said)
        started.append((process, said))
    results = []
    for process, said in started:
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        said.seek(0)
        results.append(
            {
                "cpu_s": used.ru_utime + used.ru_stime,
                "wall_s": time.monotonic() - start,
                "peak_mb": used.ru_maxrss / 1024,
                "code": process.returncode,
                "said": said.read().decode(errors="replace"),
            }
        )
        said.close()
    json.dump(results, sys.stdout)


if __name__ == "__main__":
    main()

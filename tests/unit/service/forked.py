"""Programs for fork servers, and what has become of processes."""

from __future__ import annotations

import itertools
import sys
import time
from pathlib import Path

from service.workers.forkserver import ForkServer

NO_PROCESS_ONCE = """
fork = os.fork
def refuse():
    os.fork = fork
    raise BlockingIOError
os.fork = refuse
"""
"""What a server runs first so that it cannot make the process of its first task."""


def fork_server(code: str, first: str = "") -> ForkServer:
    """Make a server whose children run Python code; `first` runs once, in the server."""
    names = "import json, os, signal, sys, time\nfrom service.workers import forking"
    program = f"{names}\n{first}\nforking.serve()\n{code}"
    return ForkServer([sys.executable, "-c", program], {})


def wait_until_gone(pid: int | str) -> str:
    """Wait until a process is dead: "gone", or "Z" when its parent has not noticed yet."""
    try:
        for _ in itertools.repeat(None):
            state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
            if state in "ZX":
                return "Z"
            time.sleep(0.01)
    except (FileNotFoundError, ProcessLookupError):
        pass
    return "gone"

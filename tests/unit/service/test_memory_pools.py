from __future__ import annotations

import subprocess
import sys


def test_threads_share_pools_of_memory() -> None:
    """glibc's own count of them, which it prints by name."""
    program = """
import ctypes, threading
from service.memory_pools import share_memory
{}
ready = threading.Barrier(16)
def work():
    ready.wait(60)
    kept = [bytes(10_000) for _ in range(100)]
    ready.wait(60)
threads = [threading.Thread(target=work) for _ in range(16)]
for thread in threads: thread.start()
for thread in threads: thread.join()
ctypes.CDLL(None).malloc_stats()
"""
    counts = []
    for first in ("", "share_memory(2)"):
        command = [sys.executable, "-c", program.format(first)]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        counts.append(done.stderr.count("Arena "))
    assert counts[0] > 2 and counts[1] == 2

from __future__ import annotations

import signal
import subprocess
import sys

import pytest

from service.workers import processes

_WAITS = "import signal, time; {}; print(flush=True); time.sleep(60)"


@pytest.mark.parametrize(
    ("first", "ended_by"),
    [
        ("signal.signal(signal.SIGTERM, signal.SIG_DFL)", signal.SIGTERM),
        ("signal.signal(signal.SIGTERM, signal.SIG_IGN)", signal.SIGKILL),
    ],
    ids=["that listens", "that does not"],
)
def test_a_child_is_ended(first: str, ended_by: signal.Signals) -> None:
    command = [sys.executable, "-c", _WAITS.format(first)]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as child:
        assert child.stdout is not None
        child.stdout.readline()
        processes.end(child, 0.5 if ended_by == signal.SIGKILL else 30)
        assert child.returncode == -ended_by


def test_threads_share_pools_of_memory() -> None:
    """glibc's own count of them, which it prints by name."""
    program = """
import ctypes, threading
from service.workers.processes import share_memory
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

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

"""Runs the command in forks of one process that has imported it: half the time of a start anew.

python -m tests.acceptance.forks reads lines of JSON from stdin, [arguments, file for what is said],
and for each it writes the exit code of `lightlayers` with these arguments to stdout.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

_PATIENCE_SECONDS = 240


class Forks:
    """The other end of that process."""

    def __init__(self, environment: Mapping[str, str]) -> None:
        command = [sys.executable, "-m", "tests.acceptance.forks"]
        pipe = subprocess.PIPE
        self._server = subprocess.Popen(command, env=environment, stdin=pipe, stdout=pipe)

    def run(self, arguments: Sequence[str], said: Path) -> int:
        """Run the command, what it says into a file; its exit code."""
        assert self._server.stdin and self._server.stdout
        self._server.stdin.write(json.dumps([arguments, str(said)]).encode() + b"\n")
        self._server.stdin.flush()
        return int(self._server.stdout.readline())

    def close(self) -> None:
        """End the process."""
        with self._server:
            self._server.kill()


def _serve() -> None:
    _import()
    for line in iter(sys.stdin.readline, ""):
        arguments, said = json.loads(line)
        child = os.fork()
        if not child:
            _run(arguments, said)
        print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)  # noqa: T201


def _import() -> None:
    """Import what the command imports only when it works, and have Numba set itself up."""
    import numpy as np

    import service.pair_tasks
    from pipeline.second_differences import BLOCK, block_squares

    assert service.pair_tasks
    block_squares(np.zeros((BLOCK, BLOCK, 3), np.float32))


def _run(arguments: Sequence[str], said: str) -> None:
    from service.cli import main

    signal.alarm(_PATIENCE_SECONDS)
    with Path(said).open("wb") as file:
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
    sys.argv = ["lightlayers", *arguments]
    main()


if __name__ == "__main__":
    _serve()

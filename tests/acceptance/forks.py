"""Runs the command in forks of one process that has imported it: half the time of a start anew.

python -m tests.acceptance.forks reads lines of JSON from stdin, [arguments, variables of the
environment, files for stdout and stderr], and for each it writes the exit code of `lightlayers`
with these arguments to stdout.
"""

from __future__ import annotations

import gc
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

    def __init__(self, environment: Mapping[str, str], folder: Path) -> None:
        """folder: an empty one, for what the runs say."""
        command = [sys.executable, "-m", "tests.acceptance.forks"]
        pipe = subprocess.PIPE
        self._server = subprocess.Popen(command, env=environment, stdin=pipe, stdout=pipe)
        self._said = folder / "stdout", folder / "stderr"

    def run(self, *arguments: object, **also: str) -> subprocess.CompletedProcess[str]:
        """Run the command with these arguments and these more variables of the environment."""
        assert self._server.stdin and self._server.stdout
        texts = [str(one) for one in arguments]
        line = json.dumps([texts, also, [str(path) for path in self._said]])
        self._server.stdin.write(line.encode() + b"\n")
        self._server.stdin.flush()
        code = int(self._server.stdout.readline())
        stdout, stderr = (path.read_text() for path in self._said)
        return subprocess.CompletedProcess(texts, code, stdout, stderr)

    def close(self) -> None:
        """End the process."""
        with self._server:
            self._server.kill()


def _serve() -> None:
    _import()
    gc.freeze()  # pages that forks share stay shared
    for line in iter(sys.stdin.readline, ""):
        arguments, also, said = json.loads(line)
        child = os.fork()
        if not child:
            _run(arguments, also, said)
        print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)  # noqa: T201


def _import() -> None:
    """Import what commands import only when they work, and have Numba set itself up."""
    import numpy as np

    import service.cli.commands
    import service.cli.explain
    import service.workers.pair_tasks
    from pipeline.pair.second_differences import BLOCK, block_squares

    assert service.cli.commands and service.cli.explain and service.workers.pair_tasks
    block_squares(np.zeros((BLOCK, BLOCK, 3), np.float32))


def _run(arguments: Sequence[str], also: Mapping[str, str], said: Sequence[str]) -> None:
    from service.cli import main

    signal.alarm(_PATIENCE_SECONDS)
    os.environ.update(also)
    for stream, path in enumerate(said, start=1):
        with Path(path).open("wb") as file:
            os.dup2(file.fileno(), stream)
    sys.argv = ["lightlayers", *arguments]
    try:
        main()
    except SystemExit as end:
        assert isinstance(end.code, int)
        sys.stdout.flush()
        os._exit(end.code)  # taking down all that was imported takes half a second


if __name__ == "__main__":
    _serve()

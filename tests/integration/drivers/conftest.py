"""A simulated camera on the network, in a process of its own."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest


class SimulatedCamera:
    """`lightlayers simcam`; order() writes a line to it."""

    def __init__(self, address: str, errors: Path) -> None:
        command = [sys.executable, "-m", "service.cli", "simcam", address, "--port", "0"]
        with errors.open("wb") as file:
            self._process = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=file, text=True
            )
        assert self._process.stdout is not None
        self.address = self._process.stdout.readline().strip()
        self.port = int(self.address.rpartition(":")[2])

    def order(self, line: str) -> None:
        """Write it a line, and wait until it holds."""
        assert self._process.stdin is not None and self._process.stdout is not None
        self._process.stdin.write(line + "\n")
        self._process.stdin.flush()
        assert self._process.stdout.readline().strip() == line

    def stop(self) -> None:
        self._process.terminate()
        self._process.wait(30)
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe:
                pipe.close()


@pytest.fixture(scope="module")
def camera(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SimulatedCamera]:
    errors = tmp_path_factory.mktemp("simcam") / "stderr"
    camera = SimulatedCamera("sim://studio?width=300&height=200&format=both", errors)
    yield camera
    camera.stop()
    assert errors.read_text() == ""


@pytest.fixture(scope="session")
def run(lacking: Callable[[str], None]) -> Callable[..., str]:
    """Run a program; gives what it writes."""

    def run(*command: str, cwd: Path | None = None) -> str:
        try:
            done = subprocess.run(
                command, cwd=cwd, capture_output=True, text=True, timeout=60, check=False
            )
        except FileNotFoundError:
            lacking(command[0])
        assert done.returncode == 0, done.stderr
        return done.stdout

    return run

"""The service under attack: a real one, in a folder of its own, and what its processes hold."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

_START_SECONDS = 120
_STOP_SECONDS = 60


class Target:
    """`lightlayers serve` with its worker."""

    def __init__(self, folder: Path) -> None:
        """Start it, and wait until it listens and its worker is ready."""
        self._log = folder / "log"
        settings = {"data_dir": folder / "data", "port": 0, "poll_seconds": 0.2, "free_bytes": 0}
        environment = {
            **{key: text for key, text in os.environ.items() if "LIGHTLAYERS_" not in key},
            **{f"LIGHTLAYERS_{name.upper()}": str(value) for name, value in settings.items()},
        }
        with self._log.open("wb") as log:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "service.cli", "serve"], env=environment, stderr=log
            )
        listening = self._await_message("listening on ")
        self.port = int(listening.rpartition(":")[2])
        self._await_message("ready")

    def _await_message(self, start: str) -> str:
        deadline = time.monotonic() + _START_SECONDS
        while time.monotonic() < deadline:
            for message in self._messages():
                if message.startswith(start):
                    return message
            if self._process.poll() is not None:
                break
            time.sleep(0.1)
        raise RuntimeError(f"the service does not start: {self._log.read_text()}")

    def _messages(self) -> list[str]:
        found = []
        for line in self._log.read_text().splitlines():
            try:
                found.append(str(json.loads(line)["message"]))
            except ValueError:
                continue  # what libraries print
        return found

    def workers_lost(self) -> int:
        """How many workers have ended so far."""
        return sum(message.startswith("the worker ended") for message in self._messages())

    def lives(self) -> bool:
        """Whether the API's process is there."""
        return self._process.poll() is None

    def memory(self) -> dict[str, float]:
        """MiB that the API and the worker hold now, each without what its children hold."""
        api = self._process.pid
        held = {"api": _status(api, "VmRSS")}
        for pid in _children(api):
            if "service.workers.worker" in _command(pid):
                held["worker"] = _status(pid, "VmRSS")
        return {name: size for name, size in held.items() if size}

    def peaks(self) -> dict[str, float]:
        """MiB that the API and its fork server held at most since forget_peaks()."""
        api = self._process.pid
        return {"api": _status(api, "VmHWM"), "fork server": _status(self._fork_server(), "VmHWM")}

    def forget_peaks(self) -> None:
        """Begin to measure anew."""
        for pid in (self._process.pid, self._fork_server()):
            Path(f"/proc/{pid}/clear_refs").write_text("5")

    def checking(self) -> float:
        """MiB that processes which read headers for the API hold now and share with nobody."""
        return sum(_private(pid) for pid in _children(self._fork_server()))

    def _fork_server(self) -> int:
        found = [
            pid for pid in _children(self._process.pid) if "service.workers.child" in _command(pid)
        ]
        return found[0]

    def close(self) -> None:
        """Stop it."""
        self._process.send_signal(signal.SIGTERM)
        try:
            self._process.wait(_STOP_SECONDS)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def tracebacks(self) -> list[str]:
        """Tracebacks that it logged: of requests and jobs that end as `internal`."""
        lines = [line for line in self._log.read_text().splitlines() if '"traceback"' in line]
        return [json.loads(line)["traceback"].strip() for line in lines]

    def log(self) -> str:
        """What it said."""
        return self._log.read_text()


def _children(pid: int) -> list[int]:
    found: list[int] = []
    for task in Path(f"/proc/{pid}/task").glob("*/children"):
        found += map(int, task.read_text().split())
    return found


def _command(pid: int) -> str:
    try:
        return Path(f"/proc/{pid}/cmdline").read_text()
    except OSError:
        return ""


def _status(pid: int, name: str) -> float:
    return _sum(Path(f"/proc/{pid}/status"), (name,))


def _private(pid: int) -> float:
    return _sum(Path(f"/proc/{pid}/smaps_rollup"), ("Private_Clean", "Private_Dirty"))


def _sum(table: Path, names: tuple[str, ...]) -> float:
    """MiB that the lines of these names give; 0 for a process that has ended."""
    try:
        lines = table.read_text().splitlines()
    except OSError:
        return 0
    return sum(int(line.split()[1]) for line in lines if line.split(":")[0] in names) / 1024

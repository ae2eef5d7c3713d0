"""A PostgreSQL server of a test's own."""

from __future__ import annotations

import os
import shutil
import stat
import subprocess
from pathlib import Path

from tests.ports import free_port

_PASS = stat.S_IXGRP | stat.S_IXOTH


class PostgreSQL:
    """A server with its data in a folder that does not exist yet, on a port of this machine."""

    def __init__(self, folder: Path, programs: Path) -> None:
        """Make its data; the user that it runs as may pass through the parents of `folder`."""
        self._programs = programs
        # PostgreSQL refuses to run as root; its package has made a user for it.
        self._user = "postgres" if os.geteuid() == 0 else None
        self._folder = folder
        folder.mkdir()
        if self._user:
            shutil.chown(folder, self._user)
            for parent in folder.parents:  # which its user has to pass through
                mode = parent.stat().st_mode
                if mode & _PASS != _PASS:
                    parent.chmod(mode | _PASS)
        self.port = free_port()
        self._data = str(folder / "data")
        self._run("initdb", "-D", self._data, "-A", "trust", "-U", "lightlayers", "--no-sync")

    def url(self, port: int | None = None) -> str:
        """Where the database `lightlayers` is, for someone who has to go through another port."""
        return f"postgresql://lightlayers@127.0.0.1:{port or self.port}/lightlayers"

    def create(self) -> None:
        """Start it for the first time, and make the database."""
        self.start()
        here = ("-h", "127.0.0.1", "-p", str(self.port), "-U", "lightlayers")
        self._run("createdb", *here, "lightlayers")

    def start(self) -> None:
        """Start it; it answers when this returns."""
        # No socket in the folder: its path may be longer than a socket's may be.
        options = f"-p {self.port} -h 127.0.0.1 -c unix_socket_directories='' -c fsync=off"
        log = str(self._folder / "log")
        self._run("pg_ctl", "-D", self._data, "-l", log, "-w", "-o", options, "start")

    def stop(self) -> None:
        """End it as a crash would."""
        self._run("pg_ctl", "-D", self._data, "-m", "immediate", "stop")

    def _run(self, *command: str) -> None:
        subprocess.run(
            [str(self._programs / command[0]), *command[1:]],
            user=self._user,
            cwd=self._folder,
            check=True,
            stdout=subprocess.DEVNULL,
        )


def find_programs() -> Path | None:
    """Find the folder of PostgreSQL's programs, None where they are not installed."""
    places = [*sorted(Path("/usr/lib/postgresql").glob("*/bin"), reverse=True)]
    found = shutil.which("initdb", path=os.pathsep.join([*map(str, places), os.environ["PATH"]]))
    return Path(found).resolve().parent if found else None

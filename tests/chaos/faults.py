"""The faults, each from its beginning to its end."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import time
from collections.abc import Callable, Iterable
from typing import TypeVar

from tests.chaos import processes
from tests.chaos.plan import Fault
from tests.chaos.processes import Process
from tests.chaos.service import Host, Service
from tests.chaos.takeovers import Takeovers

_FULL_BYTES = (2**16, 2**20, 2**22)  # what a full disk still has, if it cannot have less
_FIND_SECONDS = 5.0

One = TypeVar("One")


class Faults:
    """Breaks a service and mends it again."""

    def __init__(self, service: Service, takeovers: Takeovers) -> None:
        self._service = service
        self._takeovers = takeovers
        self._silence = service.settings.silence_seconds

    def do(self, fault: Fault) -> str:
        """Do one from beginning to end; what it hit."""
        do: Callable[[Fault], str] = getattr(self, f"_{fault.kind}")
        return do(fault)

    def _kill_worker(self, fault: Fault) -> str:
        host = self._working(fault)
        workers = host.processes("worker")
        self._lose(workers)
        processes.send(signal.SIGKILL, workers)
        return self._restart(host, fault)

    def _kill_host(self, fault: Fault) -> str:
        host = self._working(fault)
        self._lose(host.processes("worker"))
        host.kill()
        return self._restart(host, fault)

    def _kill_api(self, fault: Fault) -> str:
        host = self._answering(fault)
        host.kill()
        return self._restart(host, fault)

    def _kill_child(self, fault: Fault) -> str:
        host, found = self._running("child", fault)
        # Whoever kills a job's process has the job fail; that is no loss.
        self._takeovers.lost(self._takeovers.held_by(host.processes("worker")), timed=False)
        processes.send(signal.SIGKILL, found[:1])
        return _name(host, found[:1])

    def _kill_fork_server(self, fault: Fault) -> str:
        host, found = self._running("fork server", fault)
        processes.send(signal.SIGKILL, found)
        return _name(host, found)

    def _freeze_worker(self, fault: Fault) -> str:
        """The worker alone: its fork server and its jobs' processes go on."""
        host = self._working(fault)
        return self._freeze(host, host.processes("worker"), self._long(fault), lose=True)

    def _freeze_host(self, fault: Fault) -> str:
        host = self._working(fault)
        return self._freeze(host, host.processes(), self._long(fault), lose=True)

    def _freeze_api(self, fault: Fault) -> str:
        host = self._answering(fault)
        return self._freeze(host, host.processes(), self._short(fault))

    def _freeze_child(self, fault: Fault) -> str:
        host, found = self._running("child", fault)
        return self._freeze(host, found, self._short(fault))

    def _freeze(self, host: Host, found: list[Process], seconds: float, lose: bool = False) -> str:
        processes.send(signal.SIGSTOP, found)
        workers = [process for process in found if process.role == "worker"]
        if lose:
            self._lose(workers)
        time.sleep(seconds)
        processes.send(signal.SIGCONT, found)
        if not any(other.works for other in self._service.hosts if other is not host):
            self._takeovers.back(workers)
        return f"{_name(host, found)} for {seconds:.1f} s"

    def _restart_host(self, fault: Fault) -> str:
        host = self._working(fault)
        host.stop()
        return self._restart(host, fault)

    def _restart_api(self, fault: Fault) -> str:
        host = self._answering(fault)
        host.stop()
        return self._restart(host, fault)

    def _cut_host(self, fault: Fault) -> str:
        """A worker host that does not reach the database any more."""
        hosts = [host for host in self._service.hosts if host.relay is not None]
        host = _pick(hosts, fault)
        assert host.relay is not None
        workers = host.processes("worker")
        host.relay.cut()
        self._lose(workers)
        time.sleep(self._long(fault))
        host.relay.mend()
        return _name(host, workers)

    def _stop_database(self, fault: Fault) -> str:
        assert self._service.database is not None
        self._service.database.stop()
        time.sleep(self._short(fault))
        self._service.database.start()
        return f"for {self._short(fault):.1f} s"

    def _stop_store(self, fault: Fault) -> str:
        assert self._service.store is not None
        self._service.store.cut()
        time.sleep(self._short(fault))
        self._service.store.mend()
        return f"for {self._short(fault):.1f} s"

    def _fill_disk(self, fault: Fault) -> str:
        disk = self._service.hosts[0].disk
        if disk is None:
            return "nothing: this user may not mount a small disk"
        ballast = disk / "ballast"
        with ballast.open("wb") as file:
            for left in _FULL_BYTES:
                # Somebody else may take some of it at this moment.
                with contextlib.suppress(OSError):
                    os.posix_fallocate(file.fileno(), 0, shutil.disk_usage(disk).free - left)
                    break
        time.sleep(self._short(fault))
        ballast.unlink()
        return f"for {self._short(fault):.1f} s"

    def _restart(self, host: Host, fault: Fault) -> str:
        time.sleep(3 * fault.length)
        host.start()
        return host.data.parent.name

    def _lose(self, workers: Iterable[Process]) -> None:
        self._takeovers.lost(self._takeovers.held_by(workers))

    def _long(self, fault: Fault) -> float:
        """Longer than a worker may be silent."""
        return self._silence * (1.1 + 0.3 * fault.length) + 1

    def _short(self, fault: Fault) -> float:
        return 1 + 6 * fault.length

    def _working(self, fault: Fault) -> Host:
        return _pick([host for host in self._service.hosts if host.works], fault)

    def _answering(self, fault: Fault) -> Host:
        return _pick([host for host in self._service.hosts if host.answers], fault)

    def _running(self, role: str, fault: Fault) -> tuple[Host, list[Process]]:
        """Wait for processes of this role below the worker of one host, not of its API."""
        host = self._working(fault)
        deadline = time.monotonic() + _FIND_SECONDS
        while time.monotonic() < deadline:
            found = host.processes()
            known = {process.pid: process for process in found}
            of_worker = [one for one in found if _comes_from_worker(one, known)]
            if wanted := [one for one in of_worker if one.role == role]:
                return host, wanted
            time.sleep(0.02)
        return host, []


def _comes_from_worker(process: Process, known: dict[int, Process]) -> bool:
    above = known.get(process.parent)
    return above is not None and (above.role == "worker" or _comes_from_worker(above, known))


def _pick(hosts: list[Host], fault: Fault) -> Host:
    return hosts[int(fault.victim * len(hosts))]


def _name(host: Host, found: list[Process]) -> str:
    return f"{host.data.parent.name}: {', '.join(process.role for process in found) or 'nothing'}"

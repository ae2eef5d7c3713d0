"""A process that has imported what tasks need, and forks a child for every one of them.

A request is three descriptors: the child's stdin, its stdout and a socket. On the socket the server
says that the child is there, and at its end the exit code; when the other side closes its half,
the child and whatever it has started are killed.
"""

from __future__ import annotations

import contextlib
import gc
import os
import selectors
import signal
import socket
import sys

from service.workers.exit_codes import NO_PROCESS
from service.workers.processes import die_with_parent

FORKED = b"+"
"""What the server says once a child is there."""


def serve() -> None:
    """Fork a child for every request on stdin, until nobody is there to send one.

    Returns in the children only, each with its own stdin and stdout, in a process group of its
    own, and killed when the server ends; the server itself exits. This process must have one
    thread: what another one holds is locked in the child for ever.
    """
    # Children end when whoever asked for them says so, even where all processes get a signal.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    # What is there now is never collected, so that children go on sharing its memory.
    gc.collect()
    gc.freeze()
    if _Server().run():
        return
    sys.exit(0)


class _Server:
    def __init__(self) -> None:
        self._control = socket.socket(fileno=os.dup(0))
        self._ended, wakes = socket.socketpair()
        wakes.setblocking(False)
        self._wakes = wakes
        self._lives: dict[int, socket.socket] = {}
        self._selector = selectors.DefaultSelector()

    def run(self) -> bool:
        """Serve; true in a child, false when nobody is there any more."""
        signal.signal(signal.SIGCHLD, lambda _number, _frame: None)
        signal.set_wakeup_fd(self._wakes.fileno())
        self._selector.register(self._control, selectors.EVENT_READ)
        self._selector.register(self._ended, selectors.EVENT_READ)
        while True:
            for key, _ in self._selector.select():
                if key.fileobj is self._ended:
                    self._ended.recv(4096)
                    self._reap()
                elif key.fileobj is self._control:
                    descriptors = socket.recv_fds(self._control, 1, 3)[1]
                    if not descriptors:
                        for pid in self._lives:
                            _kill(pid)
                        return False
                    if self._fork(*descriptors):
                        return True
                elif self._lives.get(key.data) is key.fileobj:  # and was not reaped just now
                    self._selector.unregister(key.fileobj)
                    _kill(key.data)

    def _fork(self, stdin: int, stdout: int, life: int) -> bool:
        """Fork; true in the child."""
        server = os.getpid()
        told = socket.socket(fileno=life)
        try:
            pid = os.fork()
        except OSError:
            told.sendall(FORKED + str(NO_PROCESS).encode())
            told.close()
            pid = -1
        if pid == 0:
            die_with_parent(server)
            os.setpgid(0, 0)
            self._leave(told)
            os.dup2(stdin, 0)
            os.dup2(stdout, 1)
        os.close(stdin)
        os.close(stdout)
        if pid > 0:
            os.setpgid(pid, pid)  # here, too: whoever comes first
            self._lives[pid] = told
            self._selector.register(told, selectors.EVENT_READ, pid)
            told.sendall(FORKED)
        return pid == 0

    def _leave(self, told: socket.socket) -> None:
        """In a child, close what is the server's alone."""
        signal.set_wakeup_fd(-1)
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        self._selector.close()
        for one in (self._control, self._ended, self._wakes, told, *self._lives.values()):
            one.close()

    def _reap(self) -> None:
        while self._lives:
            pid, status = os.waitpid(-1, os.WNOHANG)
            if pid == 0:
                return
            with self._lives.pop(pid) as told:
                if told in self._selector.get_map():
                    self._selector.unregister(told)
                # What it has started ends with it.
                _kill(pid)
                with contextlib.suppress(BrokenPipeError):
                    told.sendall(str(os.waitstatus_to_exitcode(status)).encode())


def _kill(group: int) -> None:
    with contextlib.suppress(ProcessLookupError):
        os.killpg(group, signal.SIGKILL)

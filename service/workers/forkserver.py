"""The fork server as who has tasks sees it: service.workers.forking is the process itself."""

from __future__ import annotations

import contextlib
import errno
import os
import selectors
import socket
import subprocess
import threading
from collections.abc import Iterator, Mapping, Sequence

from service.errors import NoProcessError
from service.workers import processes
from service.workers.forking import FORKED

_FORK_SECONDS = 600.0  # what it imports first takes minutes where much else is done
_DEAF_SECONDS = 60.0  # for what is done in a moment, unless it is frozen
_SHORT = (errno.EAGAIN, errno.ENOMEM, errno.EMFILE, errno.ENFILE)
"""What the system says when it has no process, memory or descriptor left."""


class Child:
    """A forked process: `stdin` and `stdout` are the descriptors of our ends of its pipes.

    server: the process that forks it, with which it dies.
    """

    def __init__(
        self, stdin: int, stdout: int, life: socket.socket, server: subprocess.Popen[bytes]
    ) -> None:
        self._server = server
        self.stdin = os.fdopen(stdin, "wb")
        self.stdout = os.fdopen(stdout, "rb", buffering=0)
        self._life = life

    def wait(self, seconds: float) -> int:
        """Wait for its end, for some seconds > 0; its exit code, negative for a signal.

        Raises TimeoutError, and ChildProcessError when the server has died, with which the kernel
        kills its children.
        """
        self._life.settimeout(seconds)
        said = self._life.recv(16)
        if not said:
            raise ChildProcessError("the fork server has died, and its children with it")
        return int(said)

    def _await_end(self) -> None:
        while self._life.recv(16):
            pass

    def has_ended(self) -> bool:
        """Whether it is dead, without waiting; wait() then gives its exit code at once."""
        with selectors.DefaultSelector() as selector:
            selector.register(self._life, selectors.EVENT_READ)
            return bool(selector.select(0))

    def close(self) -> None:
        """Kill it and what it has started; it is gone when this returns.

        A server that is frozen and kills nothing is killed itself, and all of its children with it.
        """
        with self._life:
            self._life.settimeout(_DEAF_SECONDS)
            self._life.shutdown(socket.SHUT_WR)
            try:
                self._await_end()
            except TimeoutError:
                self._server.kill()
                self._await_end()
        self.stdout.close()
        with contextlib.suppress(BrokenPipeError):
            self.stdin.close()


class ForkServer:
    """Starts a program that calls forking.serve(), again when it has died; for several threads."""

    def __init__(self, command: Sequence[str], environment: Mapping[str, str]) -> None:
        """environment: added to that of this process."""
        self._command = command
        self._environment = environment
        self._lock = threading.Lock()
        self._running: tuple[subprocess.Popen[bytes], socket.socket] | None = None

    def start(self) -> None:
        """Have it import before the first task comes, if it can be; returns at once."""
        with self._lock, contextlib.suppress(NoProcessError):  # the first task tries again
            self._started()

    def fork(self) -> Child:
        """Fork a child, whose program goes on after serve(); one without a process ends at once.

        Its exit code is NO_PROCESS then. Raises ChildProcessError, and NoProcessError where the
        system does not let this process ask for a child.
        """
        with self._lock:
            for _ in range(2):  # it may have died since the last time
                child = _ask(*self._started())
                if child is not None:
                    return child
                self._end()
        raise ChildProcessError("the fork server ends as soon as it is started")

    def close(self) -> None:
        """End it, and the children that it has."""
        with self._lock:
            self._end()

    def _started(self) -> tuple[subprocess.Popen[bytes], socket.socket]:
        if self._running is None:
            with _no_process_when_short(), contextlib.ExitStack() as ours:
                control, theirs = socket.socketpair()
                ours.callback(control.close)
                with theirs:
                    # A session of its own: Ctrl-C on the service's terminal is not for it.
                    process = subprocess.Popen(
                        self._command,
                        env={**os.environ, **self._environment},
                        stdin=theirs.fileno(),
                        start_new_session=True,
                    )
                ours.pop_all()
            self._running = process, control
        return self._running

    def _end(self) -> None:
        if self._running is not None:
            process, control = self._running
            control.close()
            processes.end(process, _DEAF_SECONDS)
            self._running = None


def _ask(server: subprocess.Popen[bytes], control: socket.socket) -> Child | None:
    """Send a request; None when the server is dead, or was frozen and is killed for that.

    Raises NoProcessError.
    """
    # What is open is closed again where the next is not to be had: whoever waits asks often.
    with _no_process_when_short(), contextlib.ExitStack() as theirs, contextlib.ExitStack() as ours:
        child_stdin, stdin = os.pipe()
        theirs.callback(os.close, child_stdin)
        ours.callback(os.close, stdin)
        stdout, child_stdout = os.pipe()
        theirs.callback(os.close, child_stdout)
        ours.callback(os.close, stdout)
        life, child_life = socket.socketpair()
        theirs.callback(child_life.close)
        child = Child(stdin, stdout, life, server)
        ours.pop_all()
        with contextlib.suppress(ConnectionError):
            descriptors = [child_stdin, child_stdout, child_life.fileno()]
            socket.send_fds(control, [b"."], descriptors)
    life.settimeout(_FORK_SECONDS)
    try:
        forked = life.recv(len(FORKED))
    except TimeoutError:  # whoever asked would wait for ever, whatever limits its task has
        server.kill()
        forked = b""
    if forked:
        return child
    child.close()
    return None


@contextlib.contextmanager
def _no_process_when_short() -> Iterator[None]:
    """Raise NoProcessError where the system has no process, memory or descriptor left."""
    try:
        yield
    except OSError as error:
        if error.errno in _SHORT:
            raise NoProcessError from error
        raise

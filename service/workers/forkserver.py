"""A process that has imported what tasks need, and forks a child for every one of them.

Both ends of it: ForkServer has children forked; serve() is the process that forks them. A request
is three descriptors: the child's stdin, its stdout and a socket. On the socket the server says that
the child is there, and at its end the exit code; when the other side closes its half, the child
and whatever it has started are killed.
"""

from __future__ import annotations

import contextlib
import errno
import gc
import os
import selectors
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence

from service.errors import NoProcessError
from service.workers import processes
from service.workers.exit_codes import NO_PROCESS
from service.workers.processes import die_with_parent

_FORKED = b"+"
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
    """Starts a program that calls serve(), again whenever it has died; for several threads."""

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
        forked = life.recv(len(_FORKED))
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
                elif key.fileobj is not self._control:
                    if self._lives.get(key.data) is key.fileobj:  # and was not reaped just now
                        self._selector.unregister(key.fileobj)
                        _kill(key.data)
                elif descriptors := socket.recv_fds(self._control, 1, 3)[1]:
                    if self._fork(*descriptors):
                        return True
                else:
                    for pid in self._lives:
                        _kill(pid)
                    return False

    def _fork(self, stdin: int, stdout: int, life: int) -> bool:
        """Fork; true in the child."""
        server = os.getpid()
        told = socket.socket(fileno=life)
        try:
            pid = os.fork()
        except OSError:
            told.sendall(_FORKED + str(NO_PROCESS).encode())
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
            told.sendall(_FORKED)
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

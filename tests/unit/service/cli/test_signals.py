"""Commands that are told to end; each is a process of its own."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from service.cli import run

HEARD = """
import signal
for number in (signal.SIGTERM, signal.SIGHUP):  # whatever the tests themselves ignore
    signal.signal(number, signal.SIG_DFL)
signal.signal(signal.SIGINT, signal.default_int_handler)
"""

SLOW = """
import sys, time
import pipeline.process
def separate_files(_no_flash, _flash, _options, directory, *_rest, **_named):
    (directory / "lamp1.tif").write_bytes(b"half of it")
    print("begun", flush=True)
    try:
        while True:  # a signal between "begun" and one long sleep would wait for its end
            time.sleep(0.1)
    except BaseException as error:
        raise {error}
pipeline.process.separate_files = separate_files
from service.cli import main
main()
"""


@pytest.mark.parametrize("error", ["error", 'SystemError("a loop returned a result") from error'])
@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)]
)
def test_a_command_that_is_told_to_end_leaves_nothing_and_says_nothing(
    number: signal.Signals, code: int, error: str, pair: list[str], tmp_path: Path
) -> None:
    """Compiled loops make SystemErrors of what signals raise."""
    out = tmp_path / "out"
    process = subprocess.Popen(
        [sys.executable, "-c", HEARD + SLOW.format(error=error), "separate", *pair, "-o", str(out)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "begun\n"
    process.send_signal(number)
    _, said = process.communicate(timeout=60)
    assert process.returncode == code
    assert "broke inside" not in said and "Traceback" not in said
    assert not out.exists()


IMPORTING = """
import os, signal, sys
class Finder:
    def find_spec(self, name, *_rest):
        if name == "service.cli.commands":
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Finder())
from service.cli import main
main()
"""


def test_a_command_that_is_told_to_end_while_it_starts_says_nothing() -> None:
    done = subprocess.run(
        [sys.executable, "-c", HEARD + IMPORTING, "--version"], capture_output=True, text=True
    )
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "")


SERVICE = """
import os, signal
import service.serve, service.workers.worker
def wait(*_arguments):
    os.kill(os.getpid(), signal.SIGHUP)
service.serve.serve = service.workers.worker.run_until_signal = wait
from service.cli import main
main()
"""


@pytest.mark.parametrize("command", ["serve", "worker"])
def test_a_terminal_that_is_closed_ends_services_at_once(command: str, tmp_path: Path) -> None:
    """An exception in their midst waits for threads, and is told in the log."""
    done = subprocess.run(
        [sys.executable, "-c", HEARD + SERVICE, command],
        capture_output=True,
        text=True,
        cwd=tmp_path,
    )
    assert (done.returncode, done.stderr) == (-signal.SIGHUP, "")


def test_signals_that_are_ignored_stay_so(tmp_path: Path) -> None:
    """As under nohup."""
    program = (
        "import os, signal; signal.signal(signal.SIGHUP, signal.SIG_IGN);"
        "from service.cli import signals; signals.install();"
        "os.kill(os.getpid(), signal.SIGHUP); print(signals.exit_code())"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, cwd=tmp_path, check=True
    )
    assert done.stdout == "None\n"


def test_ctrl_c_ends_in_silence_also_while_a_failure_is_explained(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    def explain(_error: Exception) -> tuple[str, int]:
        raise KeyboardInterrupt

    monkeypatch.setattr("service.cli.explain.explain", explain)
    assert run(["capture", "nowhere://", "-o", str(tmp_path / "pair")]) == 130
    assert capsys.readouterr() == ("", "")

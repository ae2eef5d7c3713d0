"""The command `tether` with a camera on a bus of the test's own."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import httpx
import pytest

from drivers.ptp import usb as driver
from service.cli import run
from service.sending import sender
from service.sending.spool import Spool
from tests.unit.service.usb_bus import ADDRESS, Bus


@pytest.fixture
def bus() -> Bus:
    return Bus(away_for=3)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tmp_path / "spool"


@pytest.fixture
def tether(
    folder: Path, http: httpx.Client, bus: Bus, monkeypatch: pytest.MonkeyPatch
) -> Callable[..., int]:
    """Run the command with these lines on its stdin."""
    monkeypatch.setattr(driver, "_libusb", lambda: bus)
    monkeypatch.setattr(sender, "PAUSES_S", (0.01,))

    def run_it(*arguments: str, lines: str = "", server: str = str(http.base_url)) -> int:
        reader, writer = os.pipe()
        os.write(writer, lines.encode())
        os.close(writer)
        where = ["--server", server, "--camera", ADDRESS, "--spool", str(folder)]
        with os.fdopen(reader) as stdin, monkeypatch.context() as patched:
            patched.setattr("sys.stdin", stdin)
            return run(["tether", *where, *arguments])

    return run_it


@pytest.fixture
def waiting(folder: Path) -> Callable[[], int]:
    """Count what is left in the spool."""

    def count() -> int:
        spool = Spool(folder)
        found = spool.count()
        spool.close()
        return found

    return count

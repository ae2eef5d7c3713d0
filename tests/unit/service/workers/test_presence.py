from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from service.errors import StartError
from service.workers import presence


def _die(data_dir: Path, worker: str) -> None:
    """Have a process say that it is a worker, and kill it."""
    code = (
        "import os, pathlib, signal; from service.workers import presence\n"
        f"presence.enter(pathlib.Path({str(data_dir)!r}), {worker!r})\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == -9


def test_a_killed_process_is_told_once(tmp_path: Path) -> None:
    _die(tmp_path, "worker-1")
    assert list(presence.dead(tmp_path)) == ["worker-1"]
    assert list(presence.dead(tmp_path)) == []


def test_a_living_process_is_not_told(tmp_path: Path) -> None:
    presence.enter(tmp_path, "worker-1")
    _die(tmp_path, "worker-2")
    assert list(presence.dead(tmp_path)) == ["worker-2"]
    assert [path.name for path in (tmp_path / "workers").iterdir()] == ["worker-1"]


def test_who_fails_over_one_is_told_it_again(tmp_path: Path) -> None:
    """As when the database is away, where the death is to be written."""
    _die(tmp_path, "worker-1")
    found = presence.dead(tmp_path)
    assert next(found) == "worker-1"
    found.close()
    assert list(presence.dead(tmp_path)) == ["worker-1"]


def test_one_that_has_left_is_not_told(tmp_path: Path) -> None:
    presence.enter(tmp_path, "worker-1")
    presence.leave(tmp_path, "worker-1")
    presence.leave(tmp_path, "worker-1")
    assert list((tmp_path / "workers").iterdir()) == []


def test_one_of_which_another_worker_was_quicker_is_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _die(tmp_path, "worker-1")
    found = presence.dead(tmp_path)
    listed = sorted
    monkeypatch.setattr(
        "builtins.sorted", lambda paths: [path for path in listed(paths) if not path.unlink()]
    )
    assert list(found) == []


def test_without_a_folder_nobody_has_died(tmp_path: Path) -> None:
    assert list(presence.dead(tmp_path)) == []


def test_a_folder_that_cannot_be_written_is_told(tmp_path: Path) -> None:
    (tmp_path / "workers").touch()
    with pytest.raises(StartError, match="LIGHTLAYERS_DATA_DIR"):
        presence.enter(tmp_path, "worker-1")


def test_workers_of_other_users_hide_no_death(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _die(tmp_path, "worker-1")
    _die(tmp_path, "worker-2")
    open_any = os.open

    def open_own(path: Path, flags: int) -> int:
        if path.name == "worker-1":
            raise PermissionError
        return open_any(path, flags)

    monkeypatch.setattr(os, "open", open_own)
    assert list(presence.dead(tmp_path)) == ["worker-2"]

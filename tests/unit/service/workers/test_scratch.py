from __future__ import annotations

import errno
import fcntl
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from service.errors import StartError
from service.workers import scratch


def test_a_folder_goes_with_its_block(tmp_path: Path) -> None:
    with scratch.folder(tmp_path) as folder:
        (folder / "no_flash").write_bytes(b"photograph")
        assert folder.parent == tmp_path / "work"
    assert list((tmp_path / "work").iterdir()) == []


def test_a_folder_goes_when_the_block_fails(tmp_path: Path) -> None:
    with pytest.raises(KeyError), scratch.folder(tmp_path) as folder:
        (folder / "no_flash").write_bytes(b"photograph")
        raise KeyError
    assert list((tmp_path / "work").iterdir()) == []


def test_a_folder_that_cannot_be_removed_is_left_to_clearing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(_path: Path) -> None:
        raise PermissionError

    with monkeypatch.context() as failing:
        failing.setattr(shutil, "rmtree", fail)
        with pytest.raises(PermissionError), scratch.folder(tmp_path) as folder:
            (folder / "no_flash").write_bytes(b"photograph")
    assert folder.exists()
    scratch.clear(tmp_path)
    assert not folder.exists()


def test_a_folder_that_cannot_be_locked_is_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lock, calls = fcntl.flock, [fcntl.LOCK_EX]

    def fail_second(descriptor: int, how: int) -> None:
        if not calls:
            raise OSError(errno.ENOLCK, "no locks available")
        calls.pop()
        lock(descriptor, how)

    descriptors = Path("/proc/self/fd")
    opened = len(list(descriptors.iterdir()))
    with monkeypatch.context() as failing:
        failing.setattr(fcntl, "flock", fail_second)
        with pytest.raises(OSError, match="no locks"), scratch.folder(tmp_path):
            pass
    assert list((tmp_path / "work").iterdir()) == []
    assert len(list(descriptors.iterdir())) == opened


def test_clearing_spares_a_folder_in_use(tmp_path: Path) -> None:
    with scratch.folder(tmp_path) as folder:
        scratch.clear(tmp_path)
        assert folder.exists()


def test_clearing_removes_what_a_killed_process_left(tmp_path: Path) -> None:
    code = (
        "import os, signal, pathlib; from service.workers import scratch\n"
        f"with scratch.folder(pathlib.Path({str(tmp_path)!r})) as folder:\n"
        "    (folder / 'no_flash').write_bytes(b'photograph')\n"
        "    os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    ended = subprocess.run([sys.executable, "-c", code], check=False)
    assert ended.returncode == -9
    left = list((tmp_path / "work").iterdir())
    assert [path.name for path in left[0].iterdir()] == ["no_flash"]
    scratch.clear(tmp_path)
    assert list((tmp_path / "work").iterdir()) == []


def test_clearing_a_folder_that_cannot_be_opened_says_what_to_check(tmp_path: Path) -> None:
    folder = tmp_path / ("x" * 300)  # not even by root
    with pytest.raises(StartError, match="check LIGHTLAYERS_DATA_DIR"):
        scratch.clear(folder)


def test_clearing_before_the_first_folder_makes_their_place(tmp_path: Path) -> None:
    scratch.clear(tmp_path / "data")
    assert list((tmp_path / "data" / "work").iterdir()) == []
    assert (tmp_path / "data").stat().st_mode & 0o077 == 0


def test_a_folder_that_cannot_be_written_is_told_before_the_first_job(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "access", lambda _path, mode: not mode & os.W_OK)  # root may
    with pytest.raises(StartError, match="it cannot be written"):
        scratch.clear(tmp_path)


def test_what_another_user_has_left_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "work" / "theirs").mkdir(parents=True)

    def refuse(_path: Path) -> None:
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(shutil, "rmtree", refuse)
    with pytest.raises(StartError, match="permission denied"):
        scratch.clear(tmp_path)

from __future__ import annotations

import errno
import fcntl
import subprocess
import sys
from pathlib import Path

import pytest

from service.cli.partial import partial_folder

WRITING = """
import sys, time
from pathlib import Path
from service.cli.partial import partial_folder
with partial_folder(Path(sys.argv[1])) as folder:
    (folder / "lamp1.tif").write_text("half")
    print("begun", flush=True)
    time.sleep(60)
"""


def _names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def _killed(target: Path) -> None:
    """Leave what a run has written that is killed."""
    with subprocess.Popen(
        [sys.executable, "-c", WRITING, str(target)], stdout=subprocess.PIPE
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"begun\n"
        process.kill()


def test_a_folder_lives_as_long_as_the_block(tmp_path: Path) -> None:
    with partial_folder(tmp_path) as folder:
        assert (folder.is_relative_to(tmp_path), _names(folder)) == (True, [])
        (folder / "lamp1.tif").write_text("half")
    assert _names(tmp_path) == []


def test_what_a_killed_run_left_goes_with_the_next(tmp_path: Path) -> None:
    _killed(tmp_path)
    (left,) = _names(tmp_path)
    with partial_folder(tmp_path):
        assert left not in _names(tmp_path)
    assert _names(tmp_path) == []


def test_the_folder_of_a_run_that_lives_stays(tmp_path: Path) -> None:
    with partial_folder(tmp_path) as first:
        (first / "lamp1.tif").write_text("half")
        with partial_folder(tmp_path) as second:
            assert second != first
        assert _names(first) == ["lamp1.tif"]


def test_other_hidden_folders_stay(tmp_path: Path) -> None:
    for name in (".partial-mine", ".other"):
        (tmp_path / name).mkdir()
    (tmp_path / ".other" / "lock").write_text("")
    (tmp_path / ".partial-file").write_text("mine")
    with partial_folder(tmp_path):
        pass
    assert _names(tmp_path) == [".other", ".partial-file", ".partial-mine"]


def test_without_locks_nothing_is_cleared(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise OSError(errno.ENOTSUP, "Operation not supported")

    _killed(tmp_path)
    left = _names(tmp_path)
    monkeypatch.setattr(fcntl, "flock", refuse)
    with partial_folder(tmp_path), partial_folder(tmp_path):
        assert len(_names(tmp_path)) == 3
    assert _names(tmp_path) == left


def test_a_folder_that_is_not_there_is_told(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError), partial_folder(tmp_path / "no"):
        raise AssertionError

from __future__ import annotations

from pathlib import Path

import pytest

from service import durable


def test_a_new_file_is_written_whole(tmp_path: Path) -> None:
    durable.write(tmp_path / "a", b"light")
    durable.flush(tmp_path)
    assert (tmp_path / "a").read_bytes() == b"light"
    with pytest.raises(FileExistsError):
        durable.write(tmp_path / "a", b"other")
    assert (tmp_path / "a").read_bytes() == b"light"


def test_a_file_is_replaced_at_once(tmp_path: Path) -> None:
    (tmp_path / ".a.new").write_bytes(b"left by a crash")
    for data in (b"first", b"second"):
        durable.replace(tmp_path / "a", data)
        assert (tmp_path / "a").read_bytes() == data
    assert [path.name for path in tmp_path.iterdir()] == ["a"]


@pytest.mark.parametrize("letter", ["a", "é", "光", "💡"])
def test_a_file_of_as_long_a_name_as_there_may_be_is_replaced(tmp_path: Path, letter: str) -> None:
    name = letter * (255 // len(letter.encode()))
    durable.replace(tmp_path / name, b"light")
    assert [(path.name, path.read_bytes()) for path in tmp_path.iterdir()] == [(name, b"light")]


def test_on_a_full_disk_the_old_file_stays_and_nothing_beside_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    durable.replace(tmp_path / "a", b"first")

    def write_some(path: Path, data: bytes) -> None:
        path.write_bytes(data[:3])
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(durable, "write", write_some)
    with pytest.raises(OSError, match="No space left"):
        durable.replace(tmp_path / "a", b"second")
    assert [(path.name, path.read_bytes()) for path in tmp_path.iterdir()] == [("a", b"first")]


def test_what_is_not_there_is_not_flushed(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        durable.flush(tmp_path / "a")

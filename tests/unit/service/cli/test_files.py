from __future__ import annotations

from pathlib import Path

import pytest

from pipeline.errors import InputError, OptionError
from service.cli.files import read_file, read_table, shown


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("Küche – 写真.jpg", "Küche – 写真.jpg"),
        ("a\nb\tc\r", r"a\nb\tc\r"),
        ("\x1b[2J\x7f\x9b\u2028\u2029\x00", r"\x1b[2J\x7f\x9b\u2028\u2029\x00"),
        ("o\udcff", "o\udcff"),
        (r"a\n", r"a\n"),
    ],
)
def test_controls_of_a_name_are_escaped_and_nothing_else(text: str, expected: str) -> None:
    assert shown(text) == expected
    assert shown(Path("a\nb")) == r"a\nb"


def test_a_file_that_cannot_be_read_is_told_with_what_it_was_to_be(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"light")
    assert read_file(tmp_path / "a", "recipe") == b"light"
    for path, reason in ((tmp_path / "b", "no such file"), (tmp_path, "is a directory")):
        with pytest.raises(InputError) as told:
            read_file(path, "recipe")
        assert str(told.value).startswith(f"The recipe {path} cannot be read: {reason}")


def _parse(data: bytes) -> str:
    if data != b"a table":
        raise OptionError("It has no rows.")
    return "parsed"


def test_what_is_a_file_is_read_as_a_table_and_else_a_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("own", "own.csv"):
        Path(name).write_bytes(b"a table")
        assert read_table(name, _parse) == "parsed"
    Path("folder").mkdir()
    for name in ("xenon", "folder", "", "own/xenon"):
        assert read_table(name, _parse) == name
    assert read_table(None, _parse) is None


@pytest.mark.parametrize("name", ["lost.csv", "lost.JSON", "own.csv/lost.csv"])
def test_a_table_that_is_not_there_is_no_name(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("own.csv").write_bytes(b"")
    with pytest.raises(InputError) as told:
        read_table(name, _parse)
    assert str(told.value).startswith(f"The file {name} cannot be read: no")


def test_a_table_that_cannot_be_used_is_told_by_its_file(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(b"words")
    with pytest.raises(OptionError) as told:
        read_table(str(tmp_path / "a.csv"), _parse)
    assert str(told.value) == f"The file {tmp_path / 'a.csv'} cannot be used. It has no rows."

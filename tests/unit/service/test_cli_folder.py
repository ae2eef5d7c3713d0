from __future__ import annotations

import json
from pathlib import Path

import pytest

from pipeline.errors import InputError
from service.cli.folder import new_results


def _write(target: Path, *names: str) -> None:
    with new_results(target) as folder:
        for name in names:
            (folder / name).write_text(f"new {name}")
        files = [{"name": name} for name in names]
        (folder / "manifest.json").write_text(json.dumps({"files": files}))


def _names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_results_move_in_when_all_are_there(tmp_path: Path) -> None:
    target = tmp_path / "a" / "b"
    with new_results(target) as folder:
        (folder / "lamp1.jpg").write_text("light")
        assert not (target / "lamp1.jpg").exists()
    assert _names(target) == ["lamp1.jpg"]
    assert (target / "lamp1.jpg").read_text() == "light"


def test_the_manifest_moves_in_last(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    moved: list[str] = []
    move = Path.replace

    def replace(path: Path, target: Path) -> Path:
        moved.append(path.name)
        return move(path, target)

    monkeypatch.setattr(Path, "replace", replace)
    _write(tmp_path, "white_balanced_1.jpg", "lamp1.jpg")
    assert moved == ["lamp1.jpg", "white_balanced_1.jpg", "manifest.json"]


def test_an_earlier_runs_results_are_replaced_and_nothing_else(tmp_path: Path) -> None:
    _write(tmp_path, "lamp1.jpg", "lamp2.jpg")
    (tmp_path / "notes.txt").write_text("mine")
    _write(tmp_path, "lamp1.jpg")
    assert _names(tmp_path) == ["lamp1.jpg", "manifest.json", "notes.txt"]
    assert (tmp_path / "notes.txt").read_text() == "mine"


@pytest.mark.parametrize(
    "manifest", ["no JSON", "[]", '{"files": 3}', '{"files": [{"name": "../precious"}]}']
)
def test_a_strange_manifest_deletes_nothing(manifest: str, tmp_path: Path) -> None:
    (tmp_path / "precious").write_text("mine")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "manifest.json").write_text(manifest)
    _write(tmp_path / "out", "lamp1.jpg")
    assert (tmp_path / "precious").read_text() == "mine"
    assert _names(tmp_path / "out") == ["lamp1.jpg", "manifest.json"]


def test_a_failure_leaves_earlier_results_alone(tmp_path: Path) -> None:
    _write(tmp_path, "lamp1.jpg")
    with pytest.raises(KeyError), new_results(tmp_path) as folder:
        (folder / "lamp1.jpg").write_text("half")
        raise KeyError
    assert _names(tmp_path) == ["lamp1.jpg", "manifest.json"]
    assert (tmp_path / "lamp1.jpg").read_text() == "new lamp1.jpg"


def test_a_failure_leaves_no_new_folder(tmp_path: Path) -> None:
    with pytest.raises(KeyError), new_results(tmp_path / "out"):
        raise KeyError
    assert _names(tmp_path) == []


def test_a_file_is_no_folder(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("a file")
    with pytest.raises(InputError, match="out cannot be written: file exists"):
        _write(tmp_path / "out", "lamp1.jpg")
    with pytest.raises(InputError, match="not a directory"):
        _write(tmp_path / "out" / "below", "lamp1.jpg")
    assert (tmp_path / "out").read_text() == "a file"


def test_what_cannot_be_replaced_is_told(tmp_path: Path) -> None:
    (tmp_path / "lamp1.jpg").mkdir()
    with pytest.raises(InputError, match="cannot be written: is a directory"):
        _write(tmp_path, "lamp1.jpg")

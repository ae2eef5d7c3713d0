from __future__ import annotations

import json
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import pytest

from pipeline.errors import InputError
from service.cli.report import write_report
from service.cli.results_folder import new_results

MANIFEST: dict[str, Any] = {
    "inputs": {"no_flash": {}, "flash": {}},
    "options": {},
    "camera": {"name": "one", "source": "measured"},
    "flash": {"name": "xenon", "source": "named"},
    "lights": {"requested": "auto", "found": 0, "confidence": 1.0},
    "lamps": [],
    "filled": 0.0,
    "files": [],
    "warnings": [],
    "versions": {"lightlayers": "0.1.0"},
}


def _write(target: Path, *names: str) -> None:
    with new_results(target) as folder:
        for name in names:
            (folder / name).write_text(f"new {name}")
        (folder / "manifest.json").write_text(_manifest(*names))


def _manifest(*names: str) -> str:
    files = [{"name": name} for name in names]
    return json.dumps({"files": files, "versions": {"lightlayers": "0.1.0"}})


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


def test_what_is_listed_and_is_no_output_stays(tmp_path: Path) -> None:
    outputs = ("lamp3.tif", "response_lamp2.jpg", "layers.exr")
    others = ("my.txt", "lamp.jpg", "lamp1.jpg.txt", "../precious")
    for name in outputs + others[:-1]:
        (tmp_path / name).write_text("mine")
    (tmp_path / "manifest.json").write_text(_manifest(*outputs, *others))
    _write(tmp_path, "lamp1.jpg")
    assert _names(tmp_path) == sorted(["lamp1.jpg", "manifest.json", *others[:-1]])


@pytest.mark.parametrize("earlier", [(), ("layers.exr",)])
def test_no_other_file_is_lost(earlier: tuple[str, ...], tmp_path: Path) -> None:
    if earlier:
        _write(tmp_path, *earlier)
    (tmp_path / "lamp1.jpg").write_text("mine")
    before = _names(tmp_path)
    with pytest.raises(
        InputError,
        match=r"^The file .*lamp1.jpg would be lost, which is no result of an earlier run: give "
        r"another folder, or move it first\.$",
    ):
        _write(tmp_path, "gamma.png", "lamp1.jpg")
    assert _names(tmp_path) == before
    assert (tmp_path / "lamp1.jpg").read_text() == "mine"


@pytest.mark.parametrize(
    "manifest",
    [
        "no JSON",
        "[]",
        '{"files": 3}',
        '{"files": [{"name": "lamp1.jpg"}]}',
        '{"files": [{"name": "lamp1.jpg"}], "versions": {"another": "1"}}',
    ],
)
def test_the_manifest_of_another_program_is_not_lost(manifest: str, tmp_path: Path) -> None:
    (tmp_path / "lamp1.jpg").write_text("mine")
    (tmp_path / "manifest.json").write_text(manifest)
    with pytest.raises(InputError, match=r"manifest\.json would be lost"):
        _write(tmp_path, "lamp2.jpg")
    assert _names(tmp_path) == ["lamp1.jpg", "manifest.json"]
    assert (tmp_path / "manifest.json").read_text() == manifest


def test_photographs_that_come_without_a_manifest_replace_no_results(tmp_path: Path) -> None:
    _write(tmp_path, "lamp1.jpg")
    with new_results(tmp_path) as folder:
        (folder / "1_flash.jpg").write_text("light")
    assert _names(tmp_path) == ["1_flash.jpg", "lamp1.jpg", "manifest.json"]


@pytest.mark.parametrize("own", [True, False])
def test_the_page_of_earlier_results_goes_with_them(own: bool, tmp_path: Path) -> None:
    page = tmp_path / "report.html"
    (tmp_path / "manifest.json").write_text(json.dumps(MANIFEST))
    if own:
        write_report(tmp_path, page)
    else:
        page.write_text("<!doctype html>\nmine")
    _write(tmp_path, "lamp1.jpg")
    assert page.exists() is not own


def test_a_failure_leaves_earlier_results_alone(tmp_path: Path) -> None:
    _write(tmp_path, "lamp1.jpg")
    with pytest.raises(KeyError), new_results(tmp_path) as folder:
        (folder / "lamp1.jpg").write_text("half")
        raise KeyError
    assert _names(tmp_path) == ["lamp1.jpg", "manifest.json"]
    assert (tmp_path / "lamp1.jpg").read_text() == "new lamp1.jpg"


def test_what_a_killed_run_left_goes_with_the_next(tmp_path: Path) -> None:
    program = (
        "import os, sys; from pathlib import Path\n"
        "from service.cli.results_folder import new_results\n"
        "with new_results(Path(sys.argv[1])) as folder:\n"
        "    (folder / 'lamp1.tif').write_text('half'); os.kill(os.getpid(), 9)"
    )
    done = subprocess.run([sys.executable, "-c", program, str(tmp_path)])
    assert (done.returncode, len(_names(tmp_path))) == (-9, 1)
    _write(tmp_path, "lamp1.jpg")
    assert _names(tmp_path) == ["lamp1.jpg", "manifest.json"]


def test_a_failure_leaves_no_new_folder(tmp_path: Path) -> None:
    with pytest.raises(KeyError), new_results(tmp_path / "out"):
        raise KeyError
    assert _names(tmp_path) == []


@pytest.mark.parametrize("end", [SystemExit(143), KeyboardInterrupt(), ValueError()])
def test_a_failure_leaves_none_of_the_folders_above_a_new_one(
    end: BaseException, tmp_path: Path
) -> None:
    with pytest.raises(type(end)), new_results(tmp_path / "new" / "deep" / "pair"):
        raise end
    assert _names(tmp_path) == []


def test_a_failure_leaves_the_folders_that_were_there_or_hold_anything(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(ValueError), new_results(tmp_path / "empty" / "pair"):
        raise ValueError
    with pytest.raises(ValueError), new_results(tmp_path / "new" / "second"):
        _write(tmp_path / "new" / "first", "a")
        raise ValueError
    assert _names(tmp_path) == ["empty", "new"]
    assert _names(tmp_path / "empty") == []
    assert _names(tmp_path / "new") == ["first"]


def test_a_file_is_no_folder(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("a file")
    with pytest.raises(InputError, match="out cannot be written: file exists"):
        _write(tmp_path / "out", "lamp1.jpg")
    with pytest.raises(InputError, match="not a directory"):
        _write(tmp_path / "out" / "below", "lamp1.jpg")
    assert (tmp_path / "out").read_text() == "a file"


def test_a_path_that_is_too_long_is_told_before_any_work(tmp_path: Path) -> None:
    target = tmp_path / ("x" * 300)
    told = pytest.raises(InputError, match="x cannot be written: file name too long")
    with told, new_results(target):
        raise AssertionError
    assert _names(tmp_path) == []


def test_what_cannot_be_replaced_is_told(tmp_path: Path) -> None:
    _write(tmp_path, "lamp1.jpg")
    (tmp_path / "lamp1.jpg").unlink()
    (tmp_path / "lamp1.jpg").mkdir()
    with pytest.raises(InputError, match="cannot be written: is a directory"):
        _write(tmp_path, "lamp1.jpg")


def test_files_of_two_runs_that_end_at_once_do_not_mix(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """While the one moves its files, the other waits; then it replaces them all."""
    moving, move = threading.Event(), Path.replace

    def replace(path: Path, target: Path) -> Path:
        moving.set()
        time.sleep(0.05)
        return move(path, target)

    monkeypatch.setattr(Path, "replace", replace)
    first = threading.Thread(target=_write, args=(tmp_path, "lamp1.jpg", "lamp1.tif"))
    first.start()
    moving.wait()
    _write(tmp_path, "gamma.png", "lamp1.jpg")
    first.join()

    assert _names(tmp_path) == ["gamma.png", "lamp1.jpg", "manifest.json"]
    assert (tmp_path / "manifest.json").read_text() == _manifest("gamma.png", "lamp1.jpg")

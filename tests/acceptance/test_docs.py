"""What the documentation shows works, and its pages are those of the code."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import typer

import drivers
from service.cli.commands import app

ROOT = Path(__file__).parents[2]


def _blocks(page: str) -> list[str]:
    return re.findall(
        r"^```python\n(.*?)^```$", (ROOT / page).read_text(), re.DOTALL | re.MULTILINE
    )


@pytest.fixture
def in_folder(tmp_path: Path) -> Callable[[str], str]:
    """Run a program in a folder with a pair, a.jpg and b.jpg; what it prints."""
    with drivers.open_camera("sim://studio?lights=2&width=192&height=128&format=jpeg") as camera:
        pair = drivers.capture_pair(camera)
    (tmp_path / "a.jpg").write_bytes(pair.no_flash.best)
    (tmp_path / "b.jpg").write_bytes(pair.flash.best)

    def run(program: str) -> str:
        command = [sys.executable, "-c", program]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
        return done.stdout

    return run


def test_the_readmes_lines_of_python_separate_a_pair(
    in_folder: Callable[[str], str], tmp_path: Path
) -> None:
    (block,) = _blocks("README.md")
    assert len([line for line in block.splitlines() if line]) == 4
    in_folder(block)
    assert {"manifest.json", "lamp1.jpg", "lamp2.tif"} <= {
        path.name for path in (tmp_path / "results").iterdir()
    }


def test_the_librarys_page_runs_from_top_to_bottom(
    in_folder: Callable[[str], str], tmp_path: Path
) -> None:
    temperatures = in_folder("\n".join(_blocks("docs/library.md")))
    assert re.fullmatch(r"\[\d+, \d+\]\n", temperatures)
    assert (tmp_path / "a.dng").read_bytes() != (tmp_path / "b.dng").read_bytes()


PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


def _lines_to_type() -> Iterator[str]:
    """What follows `lightlayers` in the blocks of all pages but the reference, which is made."""
    for page in PAGES:
        if page.parent.name == "reference":
            continue
        for block in re.findall(r"^```\n(.*?)^```$", page.read_text(), re.DOTALL | re.MULTILINE):
            yield from re.findall(r"(?:^|\s|venv/bin/)lightlayers ([a-z].*)", block)


@pytest.mark.parametrize("line", sorted(set(_lines_to_type())))
def test_every_command_of_the_pages_is_one(line: str) -> None:
    """Each is parsed as if it were typed, and not run."""
    command, typed = typer.main.get_command(app), shlex.split(line, comments=True)
    while isinstance(command, typer.core.TyperGroup):
        name, *typed = typed
        command = command.commands[name]
    command.make_context("lightlayers", typed)


def test_every_option_that_the_pages_speak_of_is_one() -> None:
    known = set(re.findall(r"--[a-z][a-z-]+", (ROOT / "docs/reference/commands.md").read_text()))
    for page in PAGES:
        for command in re.findall(r"`(?:\.venv/bin/)?lightlayers ([^`]+)`", page.read_text()):
            assert set(re.findall(r"--[a-z][a-z-]+", command)) <= known, command


def test_every_test_that_the_pages_speak_of_is_one() -> None:
    texts = {path.with_suffix(""): path.read_text() for path in (ROOT / "tests").rglob("test_*.py")}
    everything = "\n".join(texts.values())
    for page in PAGES:
        named = re.findall(r"`((?:\w+/)*test_\w+)(?:\.(Test\w+)|\.py)?`", page.read_text())
        for place, group in named:
            of_file = [text for path, text in texts.items() if f"{path}".endswith(f"/{place}")]
            assert of_file or f"def {place}(" in everything, f"{place} of {page}"
            assert not group or f"class {group}:" in "\n".join(of_file), f"{group} of {page}"


def test_the_reference_is_that_of_the_code(tmp_path: Path) -> None:
    subprocess.run([sys.executable, "-m", "service.reference", tmp_path], cwd=ROOT, check=True)
    stored = {path.name: path.read_text() for path in (ROOT / "docs/reference").iterdir()}
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == stored


def test_the_site_builds_without_a_warning(tmp_path: Path) -> None:
    command = [
        sys.executable,
        "-m",
        "sphinx",
        "-W",
        "-q",
        "-d",
        f"{tmp_path}/trees",
        f"{ROOT}/docs",
    ]
    done = subprocess.run([*command, f"{tmp_path}/site"], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    front = (tmp_path / "site/index.html").read_text()
    assert not re.findall(r"<(?:script|link|img)[^>]+(?:src|href)=\"(?:https?:)?//", front)

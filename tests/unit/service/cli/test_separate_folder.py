from __future__ import annotations

import io
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pillow_heif
import pytest
from PIL import Image

from pipeline.errors import UnusablePairError
from service.cli import run, separate_folder, signals
from service.workers.shortage import TOO_LITTLE_MEMORY

Photograph = Callable[..., None]

MANIFEST: dict[str, Any] = {
    "lamps": [
        {"name": "lamp1", "cct_k": 2856.4, "srgb": "#ffb066", "family": "incandescent"},
        {"name": "lamp2", "cct_k": None, "srgb": "#80ff80", "family": "LED"},
    ],
    "files": [],
    "warnings": [{"code": "lamps_alike", "message": "Alike.", "figures": {}}],
}


@pytest.fixture
def photograph(tmp_path: Path) -> Photograph:
    """Write a photograph of a session: its name, second of the minute, and whether it flashed."""

    def write(name: str, second: int, fired: bool, kind: str = "JPEG") -> None:
        exif = Image.Exif()
        exif[0x010F] = "Nikon"
        exif.get_ifd(0x8769).update({0x9003: f"2024:05:01 12:00:{second:02}", 0x9209: int(fired)})
        file = io.BytesIO()
        pixels = np.full((48, 64, 3), 200 if fired else 90, np.uint8)
        Image.fromarray(pixels).save(file, kind, exif=exif)
        (tmp_path / "session").mkdir(exist_ok=True)
        (tmp_path / "session" / name).write_bytes(file.getvalue())

    return write


@pytest.fixture
def separated(monkeypatch: pytest.MonkeyPatch) -> list[tuple[bool, bool]]:
    """Stand in for the separation; whether each pair it got was given in the right order."""
    seen: list[tuple[bool, bool]] = []

    def separate(
        no_flash: bytes, flash: bytes, _options: Any, folder: Path, *_: Any, **__: Any
    ) -> Any:
        dark, bright = (np.asarray(Image.open(io.BytesIO(data))) for data in (no_flash, flash))
        seen.append((int(dark.mean()) == 90, int(bright.mean()) == 200))
        if len(seen) == 2:
            raise UnusablePairError("The pair is black.")
        (folder / "manifest.json").write_text(json.dumps(MANIFEST))
        return MANIFEST

    monkeypatch.setattr(separate_folder, "separate_files", separate)
    return seen


def _separate(tmp_path: Path, *more: str) -> int:
    return run(["separate", str(tmp_path / "session"), "-o", str(tmp_path / "out"), *more])


def test_every_pair_gets_a_folder_of_its_own(
    photograph: Photograph,
    separated: list[tuple[bool, bool]],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    photograph("b.jpg", 1, False)
    photograph("a.jpg", 3, True)
    assert _separate(tmp_path) == 0
    assert separated == [(True, True)]
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["b"]
    assert json.loads((tmp_path / "out/b/manifest.json").read_bytes()) == MANIFEST
    said = capsys.readouterr()
    assert said.err == "Pair 1 of 1: b.jpg, a.jpg\n"
    for words in ("b.jpg", "a.jpg", "2856 K", "LED", "lamps_alike"):
        assert words in said.out


def test_a_pair_that_fails_does_not_keep_others_back(
    photograph: Photograph,
    separated: list[tuple[bool, bool]],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    for number in range(3):
        photograph(f"{number}n.jpg", 20 * number, False)
        photograph(f"{number}f.jpg", 20 * number + 1, True)
    photograph("alone.jpg", 50, False)
    (tmp_path / "session" / "notes.txt").write_text("a nice day")
    assert _separate(tmp_path, "--json") == 2
    assert len(separated) == 3
    told = json.loads(capsys.readouterr().out)
    out = tmp_path / "out"
    assert [(one["no_flash"], one["flash"], one["folder"]) for one in told["pairs"]] == [
        (f"{number}n.jpg", f"{number}f.jpg", str(out / f"{number}n")) for number in range(3)
    ]
    assert [one.get("error") for one in told["pairs"]] == [None, "The pair is black.", None]
    assert told["pairs"][2]["manifest"] == MANIFEST
    assert sorted(path.name for path in out.iterdir()) == ["0n", "2n"]
    assert told["left"] == {
        "alone.jpg": "no photograph with the other state of the flash belongs to it",
        "notes.txt": "it is no photograph",
    }


@pytest.mark.parametrize(
    ("kept", "code", "reason"),
    [
        (20, 2, "it is a photograph that cannot be read, damaged or too large"),
        (2, 0, "it is no photograph"),
    ],
)
def test_a_damaged_photograph_is_a_failure_and_another_file_is_not(
    kept: int,
    code: int,
    reason: str,
    photograph: Photograph,
    separated: list[tuple[bool, bool]],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    for second, name in enumerate(("n.jpg", "f.jpg", "g.jpg")):
        photograph(name, second, name == "f.jpg")
    damaged = tmp_path / "session" / "g.jpg"
    damaged.write_bytes(damaged.read_bytes()[:kept])
    assert _separate(tmp_path) == code
    assert separated == [(True, True)]
    assert f"Left out: g.jpg: {reason}." in capsys.readouterr().out


@pytest.mark.parametrize(
    ("error", "told"),
    [
        (MemoryError(), TOO_LITTLE_MEMORY),
        (OSError(28, "No space left on device"), "0n cannot be written: no space left on device."),
        (ZeroDivisionError("Light."), f"report it: ZeroDivisionError in {Path(__file__).name}"),
    ],
)
def test_whatever_ends_one_pair_the_others_are_separated_and_told(
    error: Exception,
    told: str,
    photograph: Photograph,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    for number in range(2):
        photograph(f"{number}n.jpg", 20 * number, False)
        photograph(f"{number}f.jpg", 20 * number + 1, True)

    def separate(*arguments: Any, **_: Any) -> Any:
        if "0n" in arguments[3].parts:
            raise error
        return MANIFEST

    monkeypatch.setattr(separate_folder, "separate_files", separate)
    assert _separate(tmp_path, "--json") == 2
    first, second = json.loads(capsys.readouterr().out)["pairs"]
    assert told in first["error"]
    assert second["manifest"] == MANIFEST
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["1n"]


def test_a_signal_that_a_loop_made_an_error_of_ends_all(
    photograph: Photograph, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for number in range(2):
        photograph(f"{number}n.jpg", 20 * number, False)
        photograph(f"{number}f.jpg", 20 * number + 1, True)
    tried: list[str] = []

    def separate(*_: Any, **__: Any) -> None:
        tried.append("a pair")
        monkeypatch.setattr(signals, "_received", [15])
        raise SystemError("a loop returned a result with an exception set")

    monkeypatch.setattr(separate_folder, "separate_files", separate)
    assert _separate(tmp_path) == 143
    assert tried == ["a pair"]


@pytest.mark.parametrize(
    ("more", "less"),
    [
        (("PNG", "n.png", "f.png"), [("JPEG", "n.jpg", "f.jpg")]),
        (("PNG", "N.PNG", "F.PNG"), [("JPEG", "n.jpg", "f.jpg")]),
        (("PNG", "n.png", "f.png"), [("HEIF", "N.HEIC", "F.HEIC"), ("JPEG", "n.jpg", "f.jpg")]),
        (("HEIF", "n.heic", "f.heic"), [("JPEG", "n.JPG", "f.JPG")]),
    ],
    ids=["png and jpeg", "in other case", "png, heif and jpeg", "heif and jpeg"],
)
def test_of_files_of_one_name_the_one_that_holds_most_counts(
    photograph: Photograph,
    separated: list[tuple[bool, bool]],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    more: tuple[str, str, str],
    less: list[tuple[str, str, str]],
) -> None:
    pillow_heif.register_heif_opener()
    for kind, no_flash, flash in (more, *less):
        photograph(no_flash, 1, False, kind)
        photograph(flash, 2, True, kind)
    assert _separate(tmp_path, "--json") == 0
    assert len(separated) == 1
    told = json.loads(capsys.readouterr().out)
    assert [(one["no_flash"], one["flash"]) for one in told["pairs"]] == [more[1:]]
    beside = "another file of this name holds more of the photograph"
    assert told["left"] == {name: beside for _, *names in less for name in names}


def test_pairs_of_one_name_keep_their_endings(
    photograph: Photograph, separated: list[tuple[bool, bool]], tmp_path: Path
) -> None:
    photograph("n.png", 1, False, "PNG")
    photograph("f.png", 2, True, "PNG")
    photograph("n.PNG", 11, False, "PNG")
    photograph("f.PNG", 12, True, "PNG")
    photograph("m.png", 21, False, "PNG")
    photograph("g.png", 22, True, "PNG")
    assert _separate(tmp_path) == 2
    assert len(separated) == 3
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["m", "n.png"]


def _refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> str:
    assert _separate(tmp_path) == 2
    assert not (tmp_path / "out").exists()
    return capsys.readouterr().err


def test_a_folder_without_a_pair_is_told(
    photograph: Photograph, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "session cannot be read: no such file or directory." in _refused(tmp_path, capsys)
    (tmp_path / "session").mkdir()
    assert "session is empty." in _refused(tmp_path, capsys)
    photograph("a.jpg", 1, False)
    said = _refused(tmp_path, capsys)
    assert "has no pair" in said and "a.jpg, for one: no photograph with the other state" in said


def test_one_photograph_alone_is_no_pair(
    pair: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["separate", pair[0], "-o", str(tmp_path / "out")]) == 2
    assert "is one photograph: name the one with the flash, too" in capsys.readouterr().err


def test_captured_pairs_belong_together_by_name_however_close_a_burst_was(
    photograph: Photograph,
    separated: list[tuple[bool, bool]],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    for second, shot in ((0, "20240501T120000-000Z"), (3, "20240501T120003-000Z")):
        photograph(f"{shot}_no_flash.jpg", second, False)
        photograph(f"{shot}_flash.jpg", second + 2, True)
        (tmp_path / "session" / f"{shot}_recipe.json").write_text("{}")
    photograph("other.jpg", 6, False)
    photograph("another.jpg", 7, True)
    _separate(tmp_path, "--json")
    told = json.loads(capsys.readouterr().out)
    assert [(pair["no_flash"], pair["flash"]) for pair in told["pairs"]] == [
        ("20240501T120000-000Z_no_flash.jpg", "20240501T120000-000Z_flash.jpg"),
        ("20240501T120003-000Z_no_flash.jpg", "20240501T120003-000Z_flash.jpg"),
        ("other.jpg", "another.jpg"),
    ]
    assert told["left"] == {}
    assert separated == [(True, True)] * 3


def test_what_is_no_photograph_of_the_folder_is_told_or_passed_over(
    photograph: Photograph,
    separated: list[tuple[bool, bool]],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    photograph("n.jpg", 1, False)
    photograph("f.jpg", 2, True)
    folder = tmp_path / "session"
    (folder / ".DS_Store").write_bytes(b"\0\0\0\1Bud1")
    for name in ("raw", "out"):
        (folder / name).mkdir()
    assert run(["separate", str(folder), "-o", str(folder / "out"), "--json"]) == 0
    assert separated == [(True, True)]
    told = json.loads(capsys.readouterr().out)
    assert told["left"] == {"raw": "it is a folder of its own, to be named alone"}


@pytest.mark.parametrize(
    ("target", "reason", "code"),
    [
        ("nowhere", "it is no photograph", 0),
        # not even asked about, as in a forbidden folder
        ("f" * 300, "it cannot be read: file name too long", 2),
    ],
    ids=["gone", "forbidden"],
)
def test_what_is_no_file_of_the_folder_keeps_nobody_back(
    photograph: Photograph,
    separated: list[tuple[bool, bool]],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    target: str,
    reason: str,
    code: int,
) -> None:
    """Links to nowhere, a pipe that nobody writes to, and a film that no memory holds.

    What could not be read at all is a failure nevertheless: it may have been a photograph.
    """
    photograph("a.jpg", 0, fired=False)
    photograph("b.jpg", 5, fired=True)
    folder = tmp_path / "session"
    (folder / "c.jpg").symlink_to(tmp_path / "nowhere")
    os.mkfifo(folder / "d")
    (folder / "f.jpg").symlink_to(target)
    with (folder / "e.mp4").open("wb") as film:
        film.truncate(60 * 2**30)
    assert run(["separate", str(folder), "-o", str(tmp_path / "out")]) == code
    assert len(separated) == 1
    said = capsys.readouterr().out
    for name in ("c.jpg", "d", "e.mp4"):
        assert f"Left out: {name}: it is no photograph." in said
    assert f"Left out: f.jpg: {reason}." in said


def test_names_that_are_not_utf_8_keep_nobody_back(
    photograph: Photograph,
    separated: list[tuple[bool, bool]],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    photograph("a.jpg", 0, fired=False)
    photograph("b.jpg", 5, fired=True)
    photograph("c\udcff.jpg", 3600, fired=False)
    photograph("d.jpg", 3605, fired=True)
    assert run(["separate", str(tmp_path / "session"), "-o", str(tmp_path / "out")]) == 0
    assert len(separated) == 1
    said = capsys.readouterr().out
    assert r"Left out: c\udcff.jpg: its name is not UTF-8, so rename it." in said


def test_names_with_controls_do_not_act_on_the_terminal(
    photograph: Photograph,
    separated: list[tuple[bool, bool]],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    photograph("a\n\x1b[2J.jpg", 0, fired=False)
    photograph("b\r.jpg", 5, fired=True)
    (tmp_path / "session" / "c\x1b]0;title\x07.txt").write_text("")

    assert run(["separate", str(tmp_path / "session"), "-o", str(tmp_path / "out")]) == 0

    assert len(separated) == 1
    said, errors = capsys.readouterr()
    assert not {"\x1b", "\r", "\x07"} & {*said, *errors}
    assert r"Pair 1 of 1: a\n\x1b[2J.jpg, b\r.jpg" in errors
    assert r"Left out: c\x1b]0;title\x07.txt: it is no photograph." in said
    assert (tmp_path / "out" / "a\n\x1b[2J" / "manifest.json").exists()


def test_an_error_names_a_file_with_controls_on_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["separate", "a\n\x1b[2J.jpg", "b.jpg", "-o", str(tmp_path / "out")]) == 2

    assert capsys.readouterr().err.splitlines() == [
        r"The photograph a\n\x1b[2J.jpg cannot be read: no such file or directory."
    ]


@pytest.mark.parametrize(
    ("no_flash", "flash"),
    [("a_no_flash.jpg", "a_flash.JPG"), ("A_No_Flash.JPG", "A_Flash.JPG")],
)
def test_the_case_of_names_does_not_keep_a_pair_apart(
    photograph: Photograph,
    separated: list[tuple[bool, bool]],
    tmp_path: Path,
    no_flash: str,
    flash: str,
) -> None:
    """Their EXIF alone would not do: both say that the flash did not fire."""
    photograph(no_flash, 0, fired=False)
    photograph(flash, 5, fired=False)

    assert run(["separate", str(tmp_path / "session"), "-o", str(tmp_path / "out")]) == 0
    assert len(separated) == 1
    assert [path.name for path in (tmp_path / "out").iterdir()] == [Path(no_flash).stem]

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from pipeline.calibration import calibrate
from pipeline.calibration.options import CALIBRATION_OPTIONS
from pipeline.errors import UnusablePairError
from service.cli import run

Png = Callable[..., bytes]

CHART = "1,2,51,2,51,32,1,32.5"
CORNERS = [[1, 2], [51, 2], [51, 32], [1, 32.5]]
CARD = {"x": 5, "y": 6, "radius": 3.5}
PLACE = {"rgb": [1.0, 0.5, 0.25], "deviation_deg": 0.44}
FOUND: dict[str, dict[str, Any]] = {
    "flash": {
        "camera": {"name": "Nikon D5100", "source": "measured"},
        "nearest": "LED-B5",
        "cct_k": 6598,
        "duv": 0.0021,
        "patches": 24,
        "misfit": 0.0212,
    },
    "camera": {"nearest": "Nikon D5100", "flash": "led", "known_cameras": 2, "misfit": 0.004},
    "lamps": {
        "lights": [
            {**PLACE, "direction": [-0.5, 0.5, 0.70711], "strength": 1.0},
            {**PLACE, "direction": [0.8, -0.6, 0.0], "strength": 0.25},
        ],
        "sphere": CARD,
        "flash_aside_deg": 1.26,
        "misfit": 0.0123,
    },
}
FILES = {"flash": "flash.json", "camera": "camera.json", "lamps": "lights.json"}


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """What is asked of the pipeline, which answers with FOUND and one warning."""
    given: list[Any] = []

    def calibrate_files(
        no_flash: bytes, flash: bytes, options: Any, folder: Path, _progress: object
    ) -> dict[str, Any]:
        given[:] = [no_flash, flash, options]
        (folder / FILES[options.kind]).write_text(f"found: {options.kind}")
        (folder / "marks.jpg").write_bytes(b"a picture")
        return {"found": FOUND[options.kind], "warnings": [{"message": "Take care."}]}

    monkeypatch.setattr(calibrate, "calibrate_files", calibrate_files)
    return given


@pytest.mark.parametrize(
    ("arguments", "options"),
    [
        (
            ["flash", "--card", "5, 6,3.5", "--camera", "Nikon D5100", "--flash-only"],
            {"kind": "flash", "card": CARD, "camera": "Nikon D5100", "flash_only": True},
        ),
        (["flash", "--chart", CHART], {"kind": "flash", "chart": CORNERS}),
        (
            ["camera", "--chart", CHART, "--flash-spectrum", "led", "--no-align"],
            {"kind": "camera", "chart": CORNERS, "flash_spectrum": "led", "align": False},
        ),
        (["lamps", "--sphere", "5,6,3.5"], {"kind": "lamps", "sphere": CARD}),
        (
            ["lamps", "--sphere", "5,6,3.5", "--lights", "2", "--focal-px", "900"],
            {"kind": "lamps", "sphere": CARD, "lights": 2, "focal_px": 900},
        ),
    ],
)
def test_flags_are_the_options(
    arguments: list[str],
    options: dict[str, Any],
    pair: list[str],
    asked: list[Any],
    tmp_path: Path,
    png: Png,
) -> None:
    saved = tmp_path / "found.json"
    assert run(["calibrate", arguments[0], *pair, *arguments[1:], "-o", str(saved)]) == 0
    before, after = png(64, 48), png(64, 48, True)
    assert asked == [before, after, CALIBRATION_OPTIONS.validate_python(options)]
    assert saved.read_text() == f"found: {arguments[0]}"


def test_tables_are_read_from_files(pair: list[str], asked: list[Any], tmp_path: Path) -> None:
    camera, light = tmp_path / "camera.csv", tmp_path / "light.csv"
    camera.write_text("wavelength_nm,R,G,B\n400,0.1,0.2,0.3\n700,0.5,0.1,0\n")
    light.write_text("wavelength_nm,power\n400,0.5\n700,1\n")
    marks = ["--card", "5,6,3", "--camera", str(camera)]
    run(["calibrate", "flash", *pair, *marks, "-o", str(tmp_path / "found.json")])
    assert asked[2].camera.g == [0.2, 0.1]
    marks = ["--chart", CHART, "--flash-spectrum", str(light)]
    run(["calibrate", "camera", *pair, *marks, "-o", str(tmp_path / "another.json")])
    assert asked[2].flash_spectrum.power == [0.5, 1.0]


@pytest.mark.parametrize(
    ("arguments", "lines"),
    [
        (
            ["flash", "--chart", CHART],
            [
                "A flash like LED-B5, 6598 K, Duv +0.002.",
                "The 24 patches are explained to 2.1%, seen by Nikon D5100.",
            ],
        ),
        (
            ["camera", "--chart", CHART],
            [
                "A camera like Nikon D5100, under a flash like led.",
                "The 24 patches are explained to 0.4%.",
            ],
        ),
        (
            ["lamps", "--sphere", "5,6,3"],
            [
                "lamp1: 35.3° left, 30.0° up (± 0.4°), strength 1.000, colour 1.000 0.500 0.250",
                "lamp2: 90.0° right, 36.9° down (± 0.4°), strength 0.250, colour 1.000 0.500 0.250",
                "The light on the sphere is explained to 1.2%.",
                "The flash is 1.3° beside the camera.",
            ],
        ),
    ],
)
@pytest.mark.usefixtures("asked")
def test_what_was_found_is_told(
    arguments: list[str],
    lines: list[str],
    pair: list[str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    saved = str(tmp_path / "found.json")
    assert run(["calibrate", arguments[0], *pair, *arguments[1:], "-o", saved]) == 0
    said = capsys.readouterr()
    assert said.out.splitlines() == [*lines, "Warning: Take care.", saved]
    assert said.err == ""


@pytest.mark.usefixtures("asked")
def test_a_lamp_alone_is_told_without_a_strength(
    pair: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    alone = {"lights": [{**PLACE, "direction": [-0.5, 0.5, 0.70711]}], "sphere": CARD}
    monkeypatch.setitem(FOUND, "lamps", alone)
    saved = str(tmp_path / "found.json")
    assert run(["calibrate", "lamps", *pair, "--sphere", "5,6,3", "-o", saved]) == 0
    told = "lamp1: 35.3° left, 30.0° up (± 0.4°), colour 1.000 0.500 0.250"
    assert capsys.readouterr().out.splitlines()[0] == told


@pytest.mark.usefixtures("asked")
def test_a_card_and_a_flash_without_a_temperature_are_told(
    pair: list[str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(FOUND, "flash", {**FOUND["flash"], "cct_k": None, "patches": 1})
    run(["calibrate", "flash", *pair, "--card", "5,6,3", "-o", str(tmp_path / "found.json")])
    said = capsys.readouterr().out
    assert said.startswith("A flash like LED-B5.\nThe card is explained to 2.1%, seen by")


@pytest.mark.parametrize(
    ("kind", "found", "line"),
    [
        ("camera", {"flash": "table"}, "like Nikon D5100, under the flash of --flash-spectrum."),
        (
            "flash",
            {"camera": {"name": "table", "source": "file"}},
            "explained to 2.1%, seen by the camera of --camera.",
        ),
    ],
)
@pytest.mark.usefixtures("asked")
def test_what_a_file_told_is_no_name(
    kind: str,
    found: dict[str, Any],
    line: str,
    pair: list[str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(FOUND, kind, {**FOUND[kind], **found})
    run(["calibrate", kind, *pair, "--chart", CHART, "-o", str(tmp_path / "found.json")])
    assert line in capsys.readouterr().out


@pytest.mark.usefixtures("asked")
def test_a_mirror_tells_no_misfit_and_no_flash_that_it_does_not_show(
    pair: list[str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    lights = [{"direction": [0.0, 0.0, 1.0], "deviation_deg": 1.1}]
    monkeypatch.setitem(FOUND, "lamps", {"lights": lights, "sphere": CARD})
    saved = str(tmp_path / "found.json")
    run(["calibrate", "lamps", *pair, "--mirror", "--sphere", "5,6,3", "-o", saved])
    told = ["lamp1: 0.0° right, 0.0° up (± 1.1°)", "Warning: Take care.", saved]
    assert capsys.readouterr().out.splitlines() == told


@pytest.mark.usefixtures("asked")
def test_json_is_the_manifest_and_nothing_else(
    pair: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = ["-o", str(tmp_path / "found.json"), "--json"]
    assert run(["calibrate", "flash", *pair, "--card", "5,6,3", *out]) == 0
    said = capsys.readouterr()
    assert json.loads(said.out)["found"] == FOUND["flash"]
    assert said.err == ""


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["flash", "--card", "1,2,3", "--chart", CHART], "mark either a grey card"),
        (["flash", "--card", "1,2"], "--card takes 3 numbers with commas between them."),
        (["flash", "--card", "1,2,3,4"], "--card takes 3 numbers"),
        (["flash", "--card", ""], "--card takes 3 numbers"),
        (["flash", "--card", "1,2,nan"], "finite"),
        (["flash", "--card", "1,2,0"], "greater than 0"),
        (["camera", "--chart", "1,2,3"], "--chart takes 8 numbers"),
        (["camera", "--chart", CHART, "--flash-spectrum", "no.csv"], "no.csv cannot be read"),
        (["lamps", "--sphere", "1;2;3"], "--sphere takes 3 numbers"),
        (["lamps", "--sphere", "1,2,3", "--lights", "4"], "lights: "),
        (["lamps", "--sphere", "1,2,3", "--lights", "-1"], "lights: "),
        (["lamps", "--sphere", "1,2,3", "--focal-px", "0"], "focal_px: "),
    ],
)
def test_marks_that_cannot_be_used_are_one_sentence(
    arguments: list[str],
    words: str,
    pair: list[str],
    asked: list[Any],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    saved = tmp_path / "found.json"
    assert run(["calibrate", arguments[0], *pair, *arguments[1:], "-o", str(saved)]) == 2
    said = capsys.readouterr()
    assert (said.out, len(said.err.splitlines())) == ("", 1)
    assert words in said.err
    assert f"{arguments[0]}.{words}" not in said.err
    assert not asked
    assert not saved.exists()


def test_a_photograph_is_not_written_over(
    pair: list[str], asked: list[Any], capsys: pytest.CaptureFixture[str]
) -> None:
    before = Path(pair[1]).read_bytes()
    assert run(["calibrate", "flash", *pair, "--card", "5,6,3", "-o", pair[1]]) == 2
    assert "its name has to end in .json." in capsys.readouterr().err
    assert not asked
    assert Path(pair[1]).read_bytes() == before


@pytest.mark.parametrize("name", ["found.json", "found_marks.jpg"])
def test_another_file_is_not_lost_and_no_photograph_is_taken_for_it(
    name: str, asked: list[Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / name).write_bytes(b"mine")
    out = ["--camera-address", "nowhere://", "-o", str(tmp_path / "found.json")]
    assert run(["calibrate", "flash", *out]) == 2
    assert f"{name} would be lost" in capsys.readouterr().err
    assert (asked, (tmp_path / name).read_bytes()) == ([], b"mine")


def test_what_cannot_be_read_written_or_used_is_told(
    pair: list[str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    asked: list[Any],
) -> None:
    card, out = ["--card", "5,6,3"], ["-o", str(tmp_path / "found.json")]
    assert run(["calibrate", "flash", str(tmp_path / "no.png"), pair[1], *card, *out]) == 2
    assert "no.png cannot be read" in capsys.readouterr().err
    assert not asked
    nowhere = str(tmp_path / "no" / "found.json")
    assert run(["calibrate", "flash", *pair, *card, "-o", nowhere]) == 2
    said = capsys.readouterr()
    assert said.err.endswith(f"The file {nowhere} cannot be written: no such file or directory.\n")
    assert said.out == ""
    assert not asked

    def unlit(*_: object) -> None:
        raise UnusablePairError("The flash does not reach the card.")

    monkeypatch.setattr(calibrate, "calibrate_files", unlit)
    assert run(["calibrate", "flash", *pair, *card, *out]) == 2
    assert "The flash does not reach the card." in capsys.readouterr().err
    assert not (tmp_path / "found.json").exists()

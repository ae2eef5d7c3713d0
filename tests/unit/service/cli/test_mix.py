from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import pipeline.mixes.mix_files
from pipeline.arrays import Floats32
from pipeline.colour.spaces import XYZ_TO_SRGB
from pipeline.decode.exr import read_exr
from pipeline.encode.exr import write_exr
from service.cli import run

EYE = np.linalg.inv(XYZ_TO_SRGB).tolist()
LAMP = {"white": [0.95, 1.0, 1.09], "neutral_to_xyz": EYE}
BASIS = {"to_xyz": EYE, "neutral": [0.95, 1.0, 1.09], "lamps": [LAMP, LAMP]}


@pytest.fixture
def results(tmp_path: Path) -> Path:
    """Layers of 0.25 and 0.5 in all channels."""
    folder = tmp_path / "results"
    folder.mkdir()
    layer = np.full((4, 6, 3), 0.25, np.float32)
    write_exr(folder / "layers.exr", {"lamp1": layer, "lamp2": 2 * layer})
    (folder / "manifest.json").write_text(json.dumps({"mix": BASIS}))
    return folder


def mixed(results: Path, *flags: str) -> Floats32:
    """One pixel of the mix."""
    target = results.parent / "mix.exr"
    assert run(["mix", str(results), "-o", str(target), *flags]) == 0
    found: Floats32 = read_exr(target.read_bytes()).values[0, 0]
    return found


@pytest.mark.parametrize(
    ("flags", "colour"),
    [
        ([], [0.75, 0.75, 0.75]),
        (["--lamp", "1:off"], [0.5, 0.5, 0.5]),
        (["--lamp", "1:ev=-1", "--lamp", "2:ev=1, rgb=#ff0000"], [1.125, 0.125, 0.125]),
        (["--lamp", "2:rgb=ffffff,neutral,off"], [0.25, 0.25, 0.25]),
    ],
)
def test_flags_are_the_settings(results: Path, flags: list[str], colour: list[float]) -> None:
    np.testing.assert_allclose(mixed(results, *flags), colour, atol=1e-6)


def test_a_preset_is_taken_and_changed(results: Path, tmp_path: Path) -> None:
    preset = tmp_path / "preset.json"
    preset.write_text(json.dumps({"lamps": [{"on": False}, {"ev": 1, "temperature_k": None}]}))
    np.testing.assert_allclose(mixed(results, "--preset", str(preset)), 1.0, atol=1e-6)
    changed = mixed(results, "--preset", str(preset), "--lamp", "1:on")
    np.testing.assert_allclose(changed, 1.25, atol=1e-6)


def test_a_preset_may_begin_with_a_byte_order_mark(results: Path, tmp_path: Path) -> None:
    preset = tmp_path / "preset.json"
    preset.write_text(json.dumps({"lamps": [{"on": False}, {}]}), encoding="utf-8-sig")
    np.testing.assert_allclose(mixed(results, "--preset", str(preset)), 0.5, atol=1e-6)


def test_a_temperature_warms(results: Path) -> None:
    red, _, blue = mixed(results, "--lamp", "1:temperature=2700,tint=10", "--lamp", "2:off")
    assert red > 2 * blue > 0


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        pytest.param(["--lamp", "1" * 5000 + ":off"], "begin with the number", id="endless"),
        (["--lamp", "3:off"], "begin with the number of a lamp, 1 to 2, and a colon"),
        (["--lamp", "off"], "begin with the number of a lamp"),
        (["--lamp", "1:loud"], "'loud' is none of off, neutral, ev=STOPS"),
        (["--lamp", "1:ev=x"], "lamp 1, ev: "),
        (["--lamp", "1:ev=99"], "lamp 1, ev: "),
        (["--lamp", "1:tint=10"], "lamp 1: a tint needs a temperature beside it"),
        (["--lamp", "1:rgb=red"], "no colour of the form #rrggbb"),
        (["--preset", "nothing.json"], "preset nothing.json cannot be read"),
    ],
)
def test_bad_settings_are_one_sentence(
    results: Path, flags: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    target = results.parent / "mix.jpg"
    assert run(["mix", str(results), "-o", str(target), *flags]) == 2
    said = capsys.readouterr().err
    assert words in said and said.count("\n") == 1
    assert not target.exists()


@pytest.mark.parametrize(
    ("preset", "words"),
    [
        (b"{", "is no preset of the page: Invalid JSON"),
        (b"[]", "is no preset of the page: "),
        (b'{"lamps": [{"ev": "high"}, {}]}', "is no preset of the page: lamp 1, ev: "),
        (b'{"lamps": [{}, {"tint": 100}]}', "page: lamp 2: a tint needs a temperature beside it"),
        (b'{"lamps": [{}]}', "settings for 1 lamp, and the photograph has 2"),
    ],
)
def test_bad_presets_are_one_sentence(
    results: Path, tmp_path: Path, preset: bytes, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "preset.json"
    file.write_bytes(preset)
    target = str(tmp_path / "mix.jpg")
    assert run(["mix", str(results), "-o", target, "--preset", str(file)]) == 2
    said = capsys.readouterr().err
    assert words in said and said.count("\n") == 1


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("mix.gif", "/mix.gif: its name has to end in .jpg, .tif or .exr."),
        ("nowhere/mix.jpg", ": no such file or directory."),
        ("nowhere/mix.exr", ": no such file or directory."),
        (f"{'x' * 300}.jpg", ": file name too long."),
        (f"{'x' * 300}.exr", ": file name too long."),
    ],
)
def test_places_that_cannot_be_written_are_one_sentence(
    results: Path, name: str, reason: str, capsys: pytest.CaptureFixture[str]
) -> None:
    target = results.parent / name
    assert run(["mix", str(results), "-o", str(target)]) == 2
    said = capsys.readouterr().err
    assert "cannot be written" in said and said.endswith(f"{reason}\n") and said.count("\n") == 1
    assert [path.name for path in results.parent.iterdir()] == ["results"]


def test_a_folder_without_results_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[Any]
) -> None:
    assert run(["mix", str(tmp_path), "-o", str(tmp_path / "mix.jpg")]) == 2
    assert "no folder of results" in capsys.readouterr().err


def test_a_folder_is_no_picture_and_nothing_is_left_beside_it(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    target = results.parent / "mix.jpg"
    target.mkdir()
    assert run(["mix", str(results), "-o", str(target)]) == 2
    assert "is a directory" in capsys.readouterr().err
    assert sorted(path.name for path in results.parent.iterdir()) == ["mix.jpg", "results"]


@pytest.mark.parametrize("name", ["layers.exr", "lamp1.jpg", "lamp2.tif"])
def test_results_are_not_mixed_over(
    results: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Written by this program, they begin as a mix does; mixes of before are none of them."""
    assert run(["mix", str(results), "-o", str(results / "mix.jpg")]) == 0
    for other in ("lamp1.jpg", "lamp2.tif"):
        assert run(["mix", str(results), "-o", str(results / other)]) == 0
    names = ("layers.exr", "lamp1.jpg", "lamp2.tif")
    files = [{"name": one, "width": 6, "height": 4} for one in names]
    (results / "manifest.json").write_text(json.dumps({"mix": BASIS, "files": files}))
    before = (results / name).read_bytes()
    target = results / ".." / "results" / name
    assert run(["mix", str(results), "-o", str(target), "--lamp", "1:off"]) == 2
    assert f"The result {target} would be lost: give" in capsys.readouterr().err
    assert (results / name).read_bytes() == before
    assert run(["mix", str(results), "-o", str(results / "mix.jpg")]) == 0


def test_results_of_another_folder_are_not_mixed_over(
    results: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = tmp_path / "other"
    other.mkdir()
    target = other / "lamp1.jpg"
    assert run(["mix", str(results), "-o", str(target)]) == 0
    (other / "manifest.json").write_text(json.dumps({"files": [{"name": "lamp1.jpg"}]}))
    before = target.read_bytes()
    assert run(["mix", str(results), "-o", str(target), "--lamp", "1:off"]) == 2
    assert f"The result {target} would be lost: give" in capsys.readouterr().err
    assert target.read_bytes() == before
    assert run(["mix", str(results), "-o", str(other / "mix.jpg")]) == 0
    (other / "manifest.json").write_text("nothing that we wrote")
    assert run(["mix", str(results), "-o", str(other / "mix.jpg")]) == 0


@pytest.mark.parametrize("name", ["mix.jpg", "mix.tif", "mix.exr"])
def test_a_mix_replaces_one_of_before_and_no_photograph(
    results: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    target = results.parent / name
    assert run(["mix", str(results), "-o", str(target)]) == 0
    first = target.read_bytes()
    assert run(["mix", str(results), "-o", str(target), "--lamp", "1:off"]) == 0
    second = target.read_bytes()
    assert second != first
    photograph = {".jpg": jpeg(), ".tif": first[:160] + b"Camera" + first[166:], ".exr": b"v/1"}
    target.write_bytes(photograph[target.suffix])
    assert run(["mix", str(results), "-o", str(target)]) == 2
    assert f"The picture {target} would be lost" in capsys.readouterr().err
    assert target.read_bytes() == photograph[target.suffix]
    assert sorted(path.name for path in results.parent.iterdir()) == [name, "results"]


def jpeg() -> bytes:
    """As a camera writes it, with EXIF."""
    exif = Image.Exif()
    exif[0x0110] = "Camera"
    file = io.BytesIO()
    Image.new("RGB", (6, 4)).save(file, "JPEG", exif=exif)
    return file.getvalue()


def test_a_name_that_is_no_utf_8_is_told(results: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """OpenEXR ends the process over it."""
    folder = results.with_name("r\udcff\udcfe")
    results.rename(folder)
    for source, target in ((folder, results.parent / "mix.jpg"), (folder, folder / "mix.exr")):
        assert run(["mix", str(source), "-o", str(target)]) == 2
        assert "is not UTF-8" in capsys.readouterr().err
    assert sorted(path.name for path in folder.iterdir()) == ["layers.exr", "manifest.json"]


def test_two_mixes_of_one_name_at_once_are_both_whole(
    results: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The second runs while the first has written its picture, and not yet moved it."""
    mix_files, codes = pipeline.mixes.mix_files.mix_files, []

    def mix_twice(*given: Any) -> None:
        mix_files(*given)
        monkeypatch.setattr(pipeline.mixes.mix_files, "mix_files", mix_files)
        second = ["mix", str(results), "-o", str(results.parent / "mix.exr"), "--lamp", "1:off"]
        codes.append(run(second))

    monkeypatch.setattr(pipeline.mixes.mix_files, "mix_files", mix_twice)

    np.testing.assert_allclose(mixed(results), 0.75, atol=1e-6)
    assert codes == [0]
    assert sorted(path.name for path in results.parent.iterdir()) == ["mix.exr", "results"]

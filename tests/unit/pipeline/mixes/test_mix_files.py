from __future__ import annotations

import errno
import json
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
import tifffile
from PIL import Image as PillowImage

from pipeline.arrays import Floats32
from pipeline.colour.spaces import XYZ_TO_REC2020, XYZ_TO_SRGB
from pipeline.encode import jpeg
from pipeline.encode.exr import write_exr
from pipeline.encode.jpeg import to_srgb8
from pipeline.errors import Canceled, InputError
from pipeline.mixes.mix_files import format_of, mix_files, mix_results
from pipeline.mixes.mix_options import LampMix, Mix, MixRequest
from pipeline.progress import Progress

EYE: Any = np.linalg.inv(XYZ_TO_SRGB).tolist()
LAMP = {"white": [0.95, 1.0, 1.09], "neutral_to_xyz": EYE}
BASIS: dict[str, Any] = {"to_xyz": EYE, "neutral": [0.95, 1.0, 1.09], "lamps": [LAMP, LAMP]}
TWO = Mix(lamps=[LampMix(ev=-1), LampMix(rgb=(2.0, 1.0, 0.5))])


@pytest.fixture
def layers() -> Floats32:
    """Smooth, so that JPEG keeps them; higher than a strip."""
    x, y = np.meshgrid(np.linspace(0, 0.4, 40), np.linspace(0, 0.4, 150))
    return np.stack([np.stack([x, y, x], -1), np.stack([y, y, 0.4 - x], -1)]).astype(np.float32)


@pytest.fixture
def folder(tmp_path: Path, layers: Floats32) -> Path:
    write_exr(tmp_path / "layers.exr", {"lamp1": layers[0], "lamp2": layers[1]})
    (tmp_path / "manifest.json").write_text(json.dumps({"mix": BASIS}))
    return tmp_path


@pytest.fixture
def wanted(layers: Floats32) -> Floats32:
    """The mix TWO, linear sRGB."""
    return np.asarray(0.5 * layers[0] + layers[1] * [2, 1, 0.5], np.float32)


def test_an_exr_holds_the_sum(folder: Path, wanted: Floats32) -> None:
    mix_files(folder, TWO, folder / "mix.exr", Progress())

    channels = OpenEXR.File(str(folder / "mix.exr"), separate_channels=True).channels()
    found = np.stack([channels[letter].pixels for letter in "RGB"], -1)
    assert found.dtype == np.float16
    np.testing.assert_allclose(found, wanted, rtol=2**-11, atol=1e-6)


def test_a_jpeg_shows_it(folder: Path, wanted: Floats32) -> None:
    mix_files(folder, TWO, folder / "mix.jpeg", Progress())

    with PillowImage.open(folder / "mix.jpeg") as picture:
        away = np.asarray(picture).astype(int) - to_srgb8(wanted)
    assert np.abs(away).max() <= 6
    assert np.abs(away).mean() < 1


def test_clipped_light_has_the_colour_of_its_lamp(folder: Path, layers: Floats32) -> None:
    """A corner that is clipped in all channels; manifests of before do not tell where that is."""
    layers = layers.copy()
    layers[:, :20, :20] = [[[[0.75]]], [[[0.25]]]]
    write_exr(folder / "layers.exr", {"lamp1": layers[0], "lamp2": layers[1]})
    warm = np.array([1.0, 0.5, 0.25])
    lamp = LAMP | {"white": (EYE @ warm / (EYE @ warm)[1]).tolist()}
    basis = BASIS | {"clipping": 1.0, "lamps": [lamp, lamp]}
    (folder / "manifest.json").write_text(json.dumps({"mix": basis}))

    mix_files(folder, TWO, folder / "mix.exr", Progress())

    channels = OpenEXR.File(str(folder / "mix.exr"), separate_channels=True).channels()
    found = np.stack([channels[letter].pixels for letter in "RGB"], -1)
    white = 4 * warm * (0.5 * 0.75 + 0.25 * np.array([2, 1, 0.5]))
    np.testing.assert_allclose(found[10, 10], white, rtol=2e-3)
    unclipped = 0.5 * layers[0] + layers[1] * [2, 1, 0.5]
    np.testing.assert_allclose(found[20:], unclipped[20:], rtol=2**-11, atol=1e-6)


def test_a_tiff_has_it_in_rec_2020(folder: Path, wanted: Floats32) -> None:
    mix_files(folder, TWO, folder / "mix.TIF", Progress())

    linear = (wanted @ (XYZ_TO_REC2020 @ np.linalg.inv(XYZ_TO_SRGB)).T).clip(0, 1)
    np.testing.assert_allclose(tifffile.imread(folder / "mix.TIF") / 65535, linear, atol=2e-5)


@pytest.mark.parametrize(("kind", "ending"), [("jpeg", "jpg"), ("tiff", "tif"), ("exr", "exr")])
def test_results_of_a_mix_say_what_they_are(folder: Path, kind: Any, ending: str) -> None:
    mix_results(folder, MixRequest(lamps=TWO.lamps, format=kind), folder / "out", Progress())

    manifest = json.loads((folder / "out" / "manifest.json").read_bytes())
    assert sorted(path.name for path in (folder / "out").iterdir()) == [
        "manifest.json",
        f"mix.{ending}",
    ]
    (file,) = manifest["files"]
    assert (file["name"], file["width"], file["height"]) == (f"mix.{ending}", 40, 150)
    assert manifest["mix"]["lamps"][0]["ev"] == -1


@pytest.mark.parametrize("name", ["mix.gif", "mix", "mix.jpg.png"])
def test_other_formats_are_refused(name: str) -> None:
    with pytest.raises(InputError, match=r"has to end in \.jpg, \.tif or \.exr"):
        format_of(Path(name))


@pytest.mark.parametrize(
    ("name", "data", "words"),
    [
        ("manifest.json", None, "no folder of results"),
        ("manifest.json", b"{", "no folder of results"),
        ("manifest.json", b"[]", "separate the pair anew"),
        ("manifest.json", b'{"mix": {"lamps": []}}', "separate the pair anew"),
        ("layers.exr", None, "no layers.exr among the results"),
        ("layers.exr", b"no EXR", "cannot be read"),
    ],
)
def test_folders_that_cannot_be_mixed_are_refused(
    folder: Path, name: str, data: bytes | None, words: str
) -> None:
    if data is None:
        (folder / name).unlink()
    else:
        (folder / name).write_bytes(data)
    with pytest.raises(InputError, match=words):
        mix_files(folder, TWO, folder / "mix.jpg", Progress())
    assert not (folder / "mix.jpg").exists()


def test_a_refused_name_leaves_the_file_that_has_it(folder: Path) -> None:
    mine = folder / "mine.png"
    mine.write_bytes(b"mine")
    with pytest.raises(InputError, match="has to end in"):
        mix_files(folder, TWO, mine, Progress())
    assert mine.read_bytes() == b"mine"


def test_what_cannot_be_opened_leaves_the_file_that_has_its_name(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mine = folder / "mine.jpg"
    mine.write_bytes(b"mine")
    monkeypatch.setattr(jpeg, "_MOST_SIDE", 100)
    with pytest.raises(InputError, match="A JPEG cannot hold 40 × 150 pixels"):
        mix_files(folder, TWO, mine, Progress())
    assert mine.read_bytes() == b"mine"


@pytest.mark.parametrize("name", ["layers.exr", "lamp1.jpg"])
def test_results_are_not_mixed_over(folder: Path, name: str) -> None:
    (folder / "lamp1.jpg").write_bytes(b"a layer")
    files = [{"name": "layers.exr", "width": 40, "height": 150}, {"name": "lamp1.jpg"}]
    files.append({"name": "\0"})  # no name of any file
    (folder / "manifest.json").write_text(json.dumps({"mix": BASIS, "files": files}))
    before = (folder / name).read_bytes()
    with pytest.raises(InputError, match=f"The result .*{name} would be lost"):
        mix_files(folder, TWO, folder / ".." / folder.name / name, Progress())
    assert (folder / name).read_bytes() == before
    mix_files(folder, TWO, folder / "mix.jpg", Progress())


@pytest.mark.parametrize(
    "files",
    [
        [],
        [{"name": "lamp1.jpg", "width": 40, "height": 150}],
        [{"name": "layers.exr", "width": 150, "height": 40}],
        [{"name": "layers.exr"}],
        ["layers.exr", None, {"width": 40, "height": 150}],
    ],
)
def test_layers_of_another_run_are_refused(folder: Path, files: list[Any]) -> None:
    (folder / "manifest.json").write_text(json.dumps({"mix": BASIS, "files": files}))
    with pytest.raises(InputError, match=r"layers.exr is not that of the manifest.json beside it"):
        mix_files(folder, TWO, folder / "mix.jpg", Progress())
    assert not (folder / "mix.jpg").exists()


@pytest.mark.parametrize("target", [".", "..", "folder/mix"])
def test_what_is_no_picture_s_name_is_told(target: str) -> None:
    with pytest.raises(InputError) as refused:
        format_of(Path(target))
    assert str(refused.value).startswith(f"A mix cannot be written as {target}: its name has to")


def test_layers_that_may_not_be_read_are_not_called_damaged(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened = Path.open

    def refuse(path: Path, *given: Any, **named: Any) -> Any:
        if path.name == "layers.exr":
            raise PermissionError(errno.EACCES, "Permission denied")
        return opened(path, *given, **named)

    monkeypatch.setattr(Path, "open", refuse)
    with pytest.raises(InputError, match=r"^layers\.exr cannot be read: permission denied\.$"):
        mix_files(folder, TWO, folder / "mix.jpg", Progress())


def test_layers_that_break_off_leave_no_picture(
    folder: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Nor the one that was written over; and OpenEXR's own words about them are not shown."""
    (folder / "mix.exr").write_bytes(b"another")
    whole = (folder / "layers.exr").read_bytes()
    (folder / "layers.exr").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match="damaged"):
        mix_files(folder, TWO, folder / "mix.exr", Progress())
    assert not (folder / "mix.exr").exists()
    assert capfd.readouterr() == ("", "")


def test_layers_of_another_photograph_are_refused(folder: Path, layers: Floats32) -> None:
    write_exr(folder / "layers.exr", {"lamp1": layers[0]})
    with pytest.raises(InputError, match="lacks a layer"):
        mix_files(folder, TWO, folder / "mix.jpg", Progress())


def test_a_canceled_mix_leaves_no_picture(folder: Path) -> None:
    told: list[float] = []
    progress = Progress(lambda _stage, part: told.append(part), lambda: len(told) > 1)
    with pytest.raises(Canceled):
        mix_files(folder, TWO, folder / "mix.tif", progress)
    assert not (folder / "mix.tif").exists()


def test_a_mix_that_breaks_off_leaves_no_manifest_of_the_mix_before(folder: Path) -> None:
    results = folder / "out"
    wanted = MixRequest(lamps=TWO.lamps, format="tiff")
    mix_results(folder, wanted, results, Progress())
    told: list[float] = []
    progress = Progress(lambda _stage, part: told.append(part), lambda: len(told) > 1)

    with pytest.raises(Canceled):
        mix_results(folder, wanted, results, progress)

    assert list(results.iterdir()) == []


def test_a_mix_that_is_refused_leaves_the_mix_before(folder: Path) -> None:
    results = folder / "out"
    mix_results(folder, MixRequest(lamps=TWO.lamps, format="exr"), results, Progress())
    before = {path.name: path.read_bytes() for path in results.iterdir()}

    with pytest.raises(InputError):
        mix_results(folder, MixRequest(lamps=TWO.lamps[:1], format="exr"), results, Progress())

    assert {path.name: path.read_bytes() for path in results.iterdir()} == before


def test_results_of_a_mix_do_not_replace_what_was_mixed(folder: Path) -> None:
    manifest = (folder / "manifest.json").read_bytes()

    with pytest.raises(InputError, match=r"manifest\.json would be lost"):
        mix_results(folder, MixRequest(lamps=TWO.lamps, format="jpeg"), folder, Progress())

    assert (folder / "manifest.json").read_bytes() == manifest
    assert not (folder / "mix.jpg").exists()

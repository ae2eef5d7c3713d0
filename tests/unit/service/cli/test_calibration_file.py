from __future__ import annotations

import json
from pathlib import Path

import pytest

from pipeline.errors import InputError
from pipeline.options import Sensitivities, Spectrum
from pipeline.spectra.tables import write_sensitivities, write_spectrum
from pipeline.taken_with import Kind, TakenWith
from service import durable
from service.cli.calibration_file import check_target, write

TAKEN_WITH = TakenWith(make="NIKON", model="D5100")
NM = [400.0, 700.0]
FLASH = write_spectrum(Spectrum(wavelength_nm=NM, power=[1, 2], taken_with=TAKEN_WITH))
CAMERA = write_sensitivities(
    Sensitivities(wavelength_nm=NM, r=[1, 2], g=[2, 1], b=[1, 1], taken_with=TAKEN_WITH)
)
LIGHT = {"direction": [0, 0, 1], "taken_with": TAKEN_WITH.model_dump()}
LAMPS = json.dumps({"lights": [LIGHT, LIGHT]}).encode()


@pytest.mark.parametrize(
    ("kind", "earlier"), [("flash", FLASH), ("camera", CAMERA), ("lamps", LAMPS)]
)
def test_an_earlier_calibration_and_its_marks_are_replaced(
    kind: Kind, earlier: bytes, tmp_path: Path
) -> None:
    path = tmp_path / "found.json"
    check_target(kind, path)
    write(path, earlier, b"marks")
    check_target(kind, path)
    write(path, b"new", b"new marks")
    assert {file.name: file.read_bytes() for file in tmp_path.iterdir()} == {
        "found.json": b"new",
        "found_marks.jpg": b"new marks",
    }


GRID = [380.0 + 5 * i for i in range(81)]
OLDER_FLASH = write_spectrum(Spectrum(wavelength_nm=GRID, power=[i / 7 for i in range(81)]))
OLDER_CAMERA = write_sensitivities(
    Sensitivities(wavelength_nm=GRID, r=GRID, g=[1 / 3] * 81, b=[1e-7] * 81)
)
OLDER_LIGHT = {"direction": [-0.69038, 0.40893, 0.59679], "strength": 1.0, "rgb": [1.0, 0.9, 0.4]}
OLDER_LAMPS = (json.dumps({"lights": [OLDER_LIGHT]}, indent=1) + "\n").encode()


@pytest.mark.parametrize(
    ("kind", "earlier"),
    [("flash", OLDER_FLASH), ("camera", OLDER_CAMERA), ("lamps", OLDER_LAMPS)],
)
def test_a_calibration_from_before_they_said_with_what_is_replaced(
    kind: Kind, earlier: bytes, tmp_path: Path
) -> None:
    path = tmp_path / "found.json"
    write(path, earlier, b"marks")

    check_target(kind, path)

    changed = json.dumps(json.loads(earlier), indent=2).encode()  # by an editor: somebody's own
    path.write_bytes(changed)
    with pytest.raises(InputError, match=r"found\.json would be lost"):
        check_target(kind, path)


@pytest.mark.parametrize(
    ("kind", "other"),
    [
        ("flash", b""),
        ("flash", b"\xff\xd8"),
        ("flash", b"[]"),
        ("flash", b'{"lamps": [], "files": [], "versions": {"lightlayers": "0.1.0"}}'),
        ("flash", b"wavelength_nm,power\n400,1\n700,1\n"),
        ("flash", write_spectrum(Spectrum(wavelength_nm=NM, power=[1, 2]))),
        ("flash", CAMERA),
        ("camera", FLASH),
        ("lamps", FLASH),
        ("lamps", b'{"lights": []}'),
        ("lamps", b'{\n "lights": []\n}\n'),
        ("lamps", OLDER_LAMPS.replace(b"0.59679", b"0.6")),
        ("lamps", json.dumps({"lights": [LIGHT, {"direction": [0, 1, 1]}]}).encode()),
        ("lamps", json.dumps({"lights": [LIGHT], "notes": "mine"}).encode()),
    ],
)
def test_another_file_is_not_lost(kind: Kind, other: bytes, tmp_path: Path) -> None:
    path = tmp_path / "manifest.json"
    path.write_bytes(other)
    with pytest.raises(InputError, match=r"manifest\.json would be lost, .* move it first\.$"):
        check_target(kind, path)
    assert [(file.name, file.read_bytes()) for file in tmp_path.iterdir()] == [(path.name, other)]


def test_a_picture_with_the_name_of_marks_is_not_lost(tmp_path: Path) -> None:
    (tmp_path / "found_marks.jpg").write_bytes(b"mine")
    with pytest.raises(InputError, match=r"found_marks\.jpg would be lost, "):
        check_target("flash", tmp_path / "found.json")


def test_a_place_that_cannot_be_written_is_told(tmp_path: Path) -> None:
    (tmp_path / "folder.json").mkdir()
    for path, reason in (
        (tmp_path / "no" / "found.json", "written: no such file or directory"),
        (tmp_path / "folder.json", "read: is a directory"),
    ):
        with pytest.raises(InputError, match=rf"{path.name} cannot be {reason}\.$"):
            check_target("flash", path)
    assert [file.name for file in tmp_path.iterdir()] == ["folder.json"]


@pytest.mark.parametrize("full", ["found.json", "found_marks.jpg"])
def test_on_a_full_disk_no_file_is_half(
    full: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "found.json"
    write(path, b"content", b"marks")
    replace = durable.replace

    def replace_some(file: Path, data: bytes) -> None:
        if file.name == full:
            raise OSError(28, "No space left on device")
        replace(file, data)

    monkeypatch.setattr(durable, "replace", replace_some)
    with pytest.raises(InputError, match=rf"{full} cannot be written: no space left on device\.$"):
        write(path, b"new", b"new")
    expected = b"content" if full == "found.json" else b"new"
    assert (path.read_bytes(), (tmp_path / "found_marks.jpg").read_bytes()) == (expected, b"marks")

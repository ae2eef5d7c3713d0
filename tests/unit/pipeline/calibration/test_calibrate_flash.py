"""Flashes found by charts and cards, and whose colours the photographs hold."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.calibration import calibrate_flash
from pipeline.calibration.marks import disc
from pipeline.colour.temperature import cct_duv
from pipeline.errors import UnusablePairError
from pipeline.options import Circle
from pipeline.spectra.cameras import Camera
from pipeline.spectra.colorchecker import colorchecker_spectra
from pipeline.spectra.lights import find_light
from pipeline.spectra.observer import cie_1931
from pipeline.spectra.tables import parse_spectrum
from pipeline.spectra.wavelengths import WAVELENGTHS_NM
from tests.targets import (
    CORNERS,
    Shot,
    other_colorchecker,
    photograph_chart,
)
from tests.unit.pipeline.calibration.runs import (
    LAMP,
    LED,
    S,
    let_files_say,
    of_the_flash,
    run,
)


def test_a_flash_is_saved_as_separations_read_it(chart: Shot, tmp_path: Path) -> None:
    manifest = run(chart, tmp_path, kind="flash", chart=CORNERS, camera="Nikon D5100")
    data = (tmp_path / "flash.json").read_bytes()
    spectrum = find_light(parse_spectrum(data))
    seen, true = S @ spectrum, S @ LED
    assert seen / seen[1] == pytest.approx(true / true[1], rel=0.02)
    found = manifest["found"]
    assert found["nearest"] == "LED-B5"
    assert found["cct_k"] == pytest.approx(6598, abs=150)
    white = cct_duv(cie_1931() @ spectrum)
    assert white is not None and found["duv"] == pytest.approx(white[1], abs=6e-5)
    assert (found["patches"], found["camera"]["source"]) == (24, "measured")
    assert 0 < found["misfit"] < 0.05
    contents = {name: (tmp_path / name).read_bytes() for name in ("flash.json", "marks.jpg")}
    assert manifest["files"] == [
        {"name": name, "sha256": hashlib.sha256(content).hexdigest()}
        for name, content in contents.items()
    ]
    assert json.loads((tmp_path / "manifest.json").read_bytes()) == manifest
    assert manifest["options"]["kind"] == "flash"
    assert len(manifest["inputs"]["flash"]["sha256"]) == 64


def test_a_card_tells_the_flashs_colour(chart: Shot, tmp_path: Path) -> None:
    card = {"x": 14, "y": 120, "radius": 12}
    found = run(chart, tmp_path, kind="flash", card=card, camera="Nikon D5100")["found"]
    spectrum = find_light(parse_spectrum((tmp_path / "flash.json").read_bytes()))
    seen, true = S @ spectrum, S @ LED
    assert found["patches"] == 1
    assert seen / seen[1] == pytest.approx(true / true[1], rel=0.01)


def test_a_flash_is_as_strong_as_its_light_on_white(chart: Shot, tmp_path: Path) -> None:
    """By a grey card, which gives back 0.18 of it, or by the chart's white patch."""
    card = {"x": 14.0, "y": 120.0, "radius": 12.0}
    green = (chart.frames[1] - chart.frames[0])[..., 1]
    x, y = np.round(CORNERS[3]).astype(int)
    luminosity = cie_1931()[1] / cie_1931()[1].sum()
    white = float(colorchecker_spectra()[18] @ luminosity)

    by_card = run(chart, tmp_path, kind="flash", card=card, camera="Nikon D5100")["found"]
    by_chart = run(chart, tmp_path, kind="flash", chart=CORNERS, camera="Nikon D5100")["found"]

    seen = green[disc(green.shape, Circle(**card), "card")].mean()
    assert by_card["strength"] == pytest.approx(seen / 0.18, rel=1e-3)
    assert by_card["card"] == card
    seen = green[y - 2 : y + 2, x - 2 : x + 2].mean()
    assert by_chart["strength"] == pytest.approx(seen / white, rel=0.02)
    assert by_chart["chart"] == [pytest.approx(corner, abs=0.006) for corner in CORNERS]


def test_a_flash_like_no_light_has_no_temperature(chart: Shot, tmp_path: Path) -> None:
    """Of a camera that takes green for the other channels, too."""
    green = np.array([S[1] * gain for gain in (0.2, 1.0, 0.2)]) + 0.3 * S
    nm = [380.0 + 5 * i for i in range(81)]
    table = {"wavelength_nm": nm, **dict(zip("rgb", green.tolist(), strict=True))}
    card = {"x": 14, "y": 120, "radius": 12}
    found = run(chart, tmp_path, kind="flash", card=card, camera=table)["found"]
    assert (found["cct_k"], found["duv"]) == (None, None)


def test_a_wrong_camera_is_noticed(chart: Shot, tmp_path: Path) -> None:
    red_for_blue = {"wavelength_nm": [380.0 + 5 * i for i in range(81)]}
    table = {**red_for_blue, "r": S[2].tolist(), "g": S[1].tolist(), "b": S[0].tolist()}
    with pytest.raises(UnusablePairError, match="check the marks and the camera"):
        run(chart, tmp_path, kind="flash", chart=CORNERS, camera=table)


@pytest.mark.parametrize("camera", [None, "Nikon D5100"])
def test_a_rendered_picture_may_tell_the_flash(
    chart: Shot, tmp_path: Path, camera: str | None
) -> None:
    card = {"x": 14, "y": 120, "radius": 12}
    manifest = run(chart, tmp_path, kind="flash", card=card, encoding="srgb", camera=camera)
    assert manifest["found"]["patches"] == 1
    (warning,) = _of_the_camera(manifest)
    assert warning["code"] == "rendered_srgb"
    assert "the spectrum of the flash is approximate" in warning["message"]
    assert ("The camera named describes" in warning["message"]) is (camera is not None)


def test_a_file_that_names_no_camera_may_tell_the_flash(chart: Shot, tmp_path: Path) -> None:
    manifest = run(chart, tmp_path, kind="flash", card={"x": 14, "y": 120, "radius": 12})
    assert manifest["found"]["camera"] == {"name": "sRGB", "source": "stand-in"}
    (warning,) = _of_the_camera(manifest)
    assert warning["code"] == "camera_approximate"
    assert "were taken for linear sRGB: name their camera with --camera." in warning["message"]


@pytest.mark.parametrize("camera", [None, "Nikon D5100"])
def test_a_chart_refused_for_want_of_a_camera_says_so(
    chart: Shot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, camera: str | None
) -> None:
    def refuse(*_: Any) -> None:
        raise UnusablePairError("No flash explains it.")

    monkeypatch.setattr(calibrate_flash, "estimate_flash", refuse)
    with pytest.raises(UnusablePairError) as refused:
        run(chart, tmp_path, kind="flash", card={"x": 14, "y": 120, "radius": 12}, camera=camera)
    wanted = " The files do not tell whose colours they hold, and were taken for linear sRGB: name "
    wanted = "" if camera else f"{wanted}their camera with --camera."
    assert str(refused.value) == f"No flash explains it.{wanted}"


def test_a_camera_of_a_matrix_may_tell_the_flash(
    chart: Shot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(calibrate_flash, "find_camera", lambda *_: Camera("own", S, "approximate"))
    manifest = run(chart, tmp_path, kind="flash", card={"x": 14, "y": 120, "radius": 12})
    (warning,) = _of_the_camera(manifest)
    assert warning["code"] == "camera_approximate"
    assert warning["message"].endswith("name a measured camera or send its table for exact work.")


@pytest.mark.parametrize(
    ("encoding", "camera", "warned"),
    [("linear", None, True), ("linear", "Nikon D5100", False), ("raw", None, False)],
)
def test_linear_files_may_not_hold_what_the_sensor_of_their_camera_gives(
    chart: Shot,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    encoding: str,
    camera: str | None,
    warned: bool,
) -> None:
    """Of a measured camera, which RAW files and converted ones name alike."""
    let_files_say(monkeypatch, {"encoding": encoding})
    monkeypatch.setattr(
        calibrate_flash, "find_camera", lambda *_: Camera("Nikon D5100", S, "measured")
    )
    card = {"x": 14, "y": 120, "radius": 12}

    found = _of_the_camera(run(chart, tmp_path, kind="flash", card=card, camera=camera))

    assert [warning["code"] for warning in found] == ["camera_approximate"] * warned
    assert all("The files name the Nikon D5100" in warning["message"] for warning in found)


@pytest.mark.parametrize(
    "options",
    [
        {"kind": "flash", "card": {"x": 14, "y": 120, "radius": 12}, "camera": "Nikon D5100"},
        {"kind": "camera", "chart": CORNERS},
    ],
)
def test_a_camera_that_is_known_or_asked_for_is_not_warned_of(
    chart: Shot, tmp_path: Path, options: dict[str, Any]
) -> None:
    assert _of_the_camera(run(chart, tmp_path, **options)) == []


def _of_the_camera(manifest: dict[str, Any]) -> list[dict[str, Any]]:
    codes = {"rendered_srgb", "camera_approximate"}
    return [warning for warning in manifest["warnings"] if warning["code"] in codes]


@pytest.mark.parametrize(("gel", "warned"), [(None, False), (40.0, True)])
def test_a_card_in_light_like_no_flash_is_warned_of(
    tmp_path: Path, gel: float | None, warned: bool
) -> None:
    """Behind a green gel that passes so many nanometres on either side; a chart tells it."""
    passed = 1.0 if gel is None else np.exp(-0.5 * ((WAVELENGTHS_NM - 530) / gel) ** 2)
    shot = photograph_chart(S, LED * passed, LAMP, other_colorchecker(), noise=1.0)
    card = {"x": 14, "y": 120, "radius": 12}
    by_card = run(shot, tmp_path, kind="flash", card=card, camera="Nikon D5100")
    by_chart = run(shot, tmp_path, kind="flash", chart=CORNERS, camera="Nikon D5100")
    assert [
        f"which stays off by {by_card['found']['misfit']:.1%}, and with it" in message
        for message in of_the_flash(by_card)
    ] == [True] * warned
    assert of_the_flash(by_chart) == []


@pytest.mark.parametrize(("shift", "codes"), [(0, []), (1, ["camera_doubtful"])])
def test_a_camera_named_that_is_not_the_files_is_warned_of(
    chart: Shot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, shift: int, codes: list[str]
) -> None:
    """By five nanometres, as like models are."""
    exif: Any = {"make": "NIKON", "model": "D5100", "encoding": "raw"}
    let_files_say(monkeypatch, exif)
    r, g, b = np.roll(S, shift, axis=1).tolist()
    table = {"wavelength_nm": WAVELENGTHS_NM.tolist(), "r": r, "g": g, "b": b}
    manifest = run(chart, tmp_path, kind="flash", chart=CORNERS, camera=table)
    said = [warning["code"] for warning in manifest["warnings"]]
    assert [code for code in said if code.endswith("doubtful")] == codes


@pytest.mark.parametrize("camera", [None, "Nikon D5100"])
def test_the_colours_of_a_profile_may_tell_the_flash(
    chart: Shot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, camera: str | None
) -> None:
    let_files_say(monkeypatch, {"profiled": True})
    card = {"x": 14, "y": 120, "radius": 12}
    manifest = run(chart, tmp_path, kind="flash", card=card, camera=camera)
    (warning,) = _of_the_camera(manifest)
    assert warning["code"] == "camera_approximate"
    assert warning["message"].startswith(
        "The photographs hold linear values in the colours that their profile says, not those of a "
        "sensor: the spectrum of the flash is approximate. Send RAW files for exact work."
    )
    assert ("The camera named describes" in warning["message"]) is (camera is not None)

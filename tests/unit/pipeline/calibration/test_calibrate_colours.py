"""Whose colours the photographs of a calibration hold."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.calibration import calibrate as module
from pipeline.decode import decode
from pipeline.errors import OptionError
from pipeline.spectra.cameras import Camera
from pipeline.spectra.grid import WAVELENGTHS_NM
from tests.targets import CORNERS, Shot, other_colorchecker, photograph_chart
from tests.unit.pipeline.calibration.runs import LAMP, LED, S, run


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
    assert "were taken for linear sRGB. Name their camera with --camera." in warning["message"]


def test_a_camera_of_a_matrix_may_tell_the_flash(
    chart: Shot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "find_camera", lambda *_: Camera("own", S, "approximate"))
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
    monkeypatch.setattr(module, "decode", lambda *those: replace(decode(*those), encoding=encoding))
    monkeypatch.setattr(module, "find_camera", lambda *_: Camera("Nikon D5100", S, "measured"))
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


@pytest.mark.parametrize(
    ("told", "words"),
    [
        (None, "The flash was not told and the likeliest was taken, so that the camera takes over"),
        ("A", "Other flashes explain the patches far better than the one that was named, whose"),
        ("led", None),
        ("LED-B5", None),
    ],
)
def test_a_flash_that_is_not_told_or_wrong_is_warned_of(
    chart: Shot, tmp_path: Path, told: str | None, words: str | None
) -> None:
    manifest = run(chart, tmp_path, kind="camera", chart=CORNERS, flash_spectrum=told)
    said = _of_the_flash(manifest)
    assert [message[: len(words or "")] for message in said] == ([words] if words else [])


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
        for message in _of_the_flash(by_card)
    ] == [True] * warned
    assert _of_the_flash(by_chart) == []


@pytest.mark.parametrize(("shift", "codes"), [(0, []), (1, ["camera_doubtful"])])
def test_a_camera_named_that_is_not_the_files_is_warned_of(
    chart: Shot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, shift: int, codes: list[str]
) -> None:
    """By five nanometres, as like models are."""
    exif: Any = {"make": "NIKON", "model": "D5100", "encoding": "raw"}
    monkeypatch.setattr(module, "decode", lambda *those: replace(decode(*those), **exif))
    r, g, b = np.roll(S, shift, axis=1).tolist()
    table = {"wavelength_nm": WAVELENGTHS_NM.tolist(), "r": r, "g": g, "b": b}
    manifest = run(chart, tmp_path, kind="flash", chart=CORNERS, camera=table)
    said = [warning["code"] for warning in manifest["warnings"]]
    assert [code for code in said if code.endswith("doubtful")] == codes


def _of_the_flash(manifest: dict[str, Any]) -> list[str]:
    warnings = manifest["warnings"]
    return [warning["message"] for warning in warnings if warning["code"] == "flash_doubtful"]


def test_a_rendered_picture_tells_no_sensitivities(chart: Shot, tmp_path: Path) -> None:
    with pytest.raises(OptionError, match="rendered to sRGB"):
        run(chart, tmp_path, kind="camera", chart=CORNERS, encoding="srgb")
    assert list(tmp_path.iterdir()) == []


def _profiled(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let files say by a linear profile what colours they hold."""
    monkeypatch.setattr(module, "decode", lambda *those: replace(decode(*those), profiled=True))


def test_the_colours_of_a_profile_tell_no_sensitivities(
    chart: Shot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _profiled(monkeypatch)
    with pytest.raises(OptionError, match="the colours that their profile says"):
        run(chart, tmp_path, kind="camera", chart=CORNERS)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("camera", [None, "Nikon D5100"])
def test_the_colours_of_a_profile_may_tell_the_flash(
    chart: Shot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, camera: str | None
) -> None:
    _profiled(monkeypatch)
    card = {"x": 14, "y": 120, "radius": 12}
    manifest = run(chart, tmp_path, kind="flash", card=card, camera=camera)
    (warning,) = _of_the_camera(manifest)
    assert warning["code"] == "camera_approximate"
    assert warning["message"].startswith(
        "The photographs hold linear values in the colours that their profile says, not those of a "
        "sensor: the spectrum of the flash is approximate. Send RAW files for exact work."
    )
    assert ("The camera named describes" in warning["message"]) is (camera is not None)

"""Cameras found by charts."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pipeline.calibration import calibrate_camera
from pipeline.errors import OptionError
from pipeline.spectra.cameras import Camera
from pipeline.spectra.tables import parse_sensitivities
from tests.targets import (
    CORNERS,
    Shot,
)
from tests.unit.pipeline.calibration.runs import (
    LED,
    S,
    let_files_say,
    of_the_flash,
    run,
)


def test_a_camera_is_found_under_a_flash_of_a_table(chart: Shot, tmp_path: Path) -> None:
    nm = [380.0 + 5 * i for i in range(81)]
    flash = {"wavelength_nm": nm, "power": LED.tolist()}
    found = run(chart, tmp_path, kind="camera", chart=CORNERS, flash_spectrum=flash)["found"]
    assert (found["nearest"], found["flash"]) == ("Nikon D5100", "table")
    by_name = run(chart, tmp_path, kind="camera", chart=CORNERS, flash_spectrum="led")["found"]
    assert found["misfit"] == by_name["misfit"] < 0.03


def test_a_camera_of_a_known_matrix_may_be_like_itself(
    chart: Shot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    own = Camera("own", S, "approximate")
    monkeypatch.setattr(calibrate_camera, "find_camera", lambda *_: own)
    found = run(chart, tmp_path, kind="camera", chart=CORNERS, flash_spectrum="led")["found"]
    assert found["known_cameras"] == 3


def test_no_file_of_the_folder_changes_the_flashes_that_a_camera_is_tried_with(
    chart: Shot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "LED-B5.csv").write_text("wavelength_nm,power\n400,1\n700,9\n")
    monkeypatch.setenv("LIGHTLAYERS_SPECTRA", str(tmp_path))
    found = run(chart, tmp_path / "out", kind="camera", chart=CORNERS)["found"]
    assert (found["nearest"], found["flash"]) == ("Nikon D5100", "LED-B5")


@pytest.mark.parametrize("told", ["led", None])
def test_a_camera_is_saved_as_separations_read_it(
    chart: Shot, tmp_path: Path, told: str | None
) -> None:
    found = run(chart, tmp_path, kind="camera", chart=CORNERS, flash_spectrum=told)["found"]
    table = parse_sensitivities((tmp_path / "camera.json").read_bytes())
    curves = np.array([table.r, table.g, table.b])
    cosines = (curves * S).sum(1) / np.linalg.norm(curves, axis=1) / np.linalg.norm(S, axis=1)
    assert cosines.min() > np.cos(np.radians(8))
    assert (found["nearest"], found["known_cameras"]) == ("Nikon D5100", 2)
    assert found["flash"] == (told or "LED-B5")


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
    said = of_the_flash(manifest)
    assert [message[: len(words or "")] for message in said] == ([words] if words else [])


def test_a_rendered_picture_tells_no_sensitivities(chart: Shot, tmp_path: Path) -> None:
    with pytest.raises(OptionError, match="rendered to sRGB"):
        run(chart, tmp_path, kind="camera", chart=CORNERS, encoding="srgb")
    assert list(tmp_path.iterdir()) == []


def test_the_colours_of_a_profile_tell_no_sensitivities(
    chart: Shot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    let_files_say(monkeypatch, {"profiled": True})
    with pytest.raises(OptionError, match="the colours that their profile says"):
        run(chart, tmp_path, kind="camera", chart=CORNERS)
    assert list(tmp_path.iterdir()) == []

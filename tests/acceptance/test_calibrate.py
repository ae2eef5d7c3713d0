"""Calibration as a customer does it: by command, and over HTTP with a job that names it."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
import tifffile

from pipeline.spectra.lights import find_light
from pipeline.vectors import unit
from tests.evaluation.spectra import sensitivities
from tests.targets import (
    CIRCLE,
    CORNERS,
    FOCAL_PX,
    Shot,
    other_colorchecker,
    photograph_chart,
    photograph_sphere,
)

CAMERA = "Nikon D5100"
DIRECTIONS = unit(np.array([(-0.9, 0.3, 0.2), (0.2, 0.7, 0.6), (0.7, -0.5, 0.4)]))
COLOURS = np.array([(0.3, 0.2, 0.1), (0.2, 0.4, 0.3), (0.2, 0.25, 0.35)])
PATIENCE_SECONDS = 240
CHART = ",".join(f"{value:g}" for corner in CORNERS for value in corner)
SPHERE = ",".join(f"{CIRCLE[name]:g}" for name in ("x", "y", "radius"))
LINEAR = ("--exposure-ratio", "1")


def _unfit(manifest: dict[str, Any]) -> list[str]:
    """What a run says of calibrations that were named and do not fit."""
    found = (one for one in manifest["warnings"] if one["code"] == "calibration_unfit")
    return [one["message"] for one in found]


def _saved(shot: Shot, folder: Path, name: str) -> tuple[Path, Path]:
    paths = (folder / f"{name}_no_flash.tif", folder / f"{name}_flash.tif")
    for path, data in zip(paths, shot.files, strict=True):
        path.write_bytes(data)
    return paths


@pytest.fixture(scope="module")
def chart(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A noisy chart under a white LED."""
    shot = photograph_chart(
        sensitivities(CAMERA), find_light("led"), find_light("A"), other_colorchecker(), 1.0
    )
    return _saved(shot, tmp_path_factory.mktemp("targets"), "chart")


@pytest.fixture(scope="module")
def sphere(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A noisy sphere under three lamps."""
    shot = photograph_sphere(DIRECTIONS, COLOURS, noise=1.0, paint=0.02)
    return _saved(shot, tmp_path_factory.mktemp("targets"), "sphere")


@pytest.fixture(scope="module")
def calibrate(lightlayers: Callable[..., Any]) -> Callable[..., Any]:
    """Run `lightlayers calibrate` with these arguments."""
    return partial(lightlayers, "calibrate")


def test_the_flash_calibrated_is_the_one_that_separate_takes(
    calibrate: Callable[..., Any], command: Callable[..., Any], chart: Any, tmp_path: Path
) -> None:
    saved = tmp_path / "flash.json"
    done = calibrate("flash", *chart, *LINEAR, "--camera", CAMERA, "--chart", CHART, "-o", saved)
    assert done.returncode == 0, done.stderr
    assert "A flash like LED-B5, 6" in done.stdout
    assert "The 24 patches are explained to 2." in done.stdout
    flags = ("--camera", CAMERA, "--flash-spectrum", saved, "--lights", "1")
    run = command(chart, *LINEAR, *flags, "--outputs", "lamps.jpg")
    assert run.code == 0, run.stderr
    manifest = run.results.manifest
    assert manifest["flash"]["source"] == "file"
    # the lamp on the chart is the CIE illuminant A of 2856 K
    assert manifest["lamps"][0]["cct_k"] == pytest.approx(2856, abs=60)


def test_the_camera_calibrated_is_the_one_that_separate_takes(
    calibrate: Callable[..., Any], command: Callable[..., Any], chart: Any, tmp_path: Path
) -> None:
    saved = tmp_path / "camera.json"
    done = calibrate(
        "camera", *chart, *LINEAR, "--flash-spectrum", "led", "--chart", CHART, "-o", saved
    )
    assert done.returncode == 0, done.stderr
    assert "A camera like Nikon D5100, under a flash like led." in done.stdout
    flags = ("--camera", saved, "--flash-spectrum", "led", "--lights", "1")
    run = command(chart, *LINEAR, *flags, "--outputs", "lamps.jpg")
    assert run.code == 0, run.stderr
    assert run.results.manifest["camera"]["source"] == "file"
    assert run.results.manifest["lamps"][0]["cct_k"] == pytest.approx(2856, abs=100)


def test_the_lamps_calibrated_are_those_that_separate_takes(
    calibrate: Callable[..., Any], command: Callable[..., Any], sphere: Any, tmp_path: Path
) -> None:
    saved = tmp_path / "lights.json"
    focal = ("--focal-px", FOCAL_PX)
    done = calibrate("lamps", *sphere, *LINEAR, *focal, "--sphere", SPHERE, "-o", saved)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("strength") == 3
    lights = json.loads(saved.read_bytes())["lights"]
    found = np.array([light["direction"] for light in lights])
    lengths = np.linalg.norm(found, axis=1, keepdims=True)
    np.testing.assert_allclose(lengths, 1, atol=1e-4)  # they are written with five digits
    chords = np.linalg.norm(DIRECTIONS[:, None] - found / lengths, axis=2).min(axis=1)
    assert np.degrees(2 * np.arcsin(chords / 2)).max() < 1.0
    flags = ("--camera", CAMERA, *focal, "--light-directions", saved, "--method", "paper")
    run = command(sphere, *LINEAR, *flags, "--outputs", "normals.exr")
    assert run.code == 0, run.stderr
    assert run.results.manifest["options"]["light_directions"] == lights
    assert "normals.exr" in run.results.files
    assert _unfit(run.results.manifest) == []
    # the camera stands on its head: by its EXIF the picture is upright, its directions are not
    for path in sphere:
        tags = [(274, "H", 1, 3, True)]  # EXIF's orientation
        data = tifffile.imread(path)
        tifffile.imwrite(tmp_path / path.name, data, photometric="rgb", extratags=tags)
    heads = tuple(tmp_path / path.name for path in sphere)
    run = command(heads, *LINEAR, *flags, "--outputs", "normals.exr")
    assert run.code == 0, run.stderr
    assert run.results.manifest["options"]["light_directions"] == lights
    (told,) = _unfit(run.results.manifest)
    assert "turned another way (EXIF orientation 1, of these 3)" in told


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("flash", "--card", "1,2"), "--card takes 3 numbers with commas between them."),
        (("flash", "--card", "30,120,x"), "--card takes 3 numbers with commas between them."),
        (("flash", "--card", "5,5,20"), "The circle of the grey card is not wholly inside"),
        (("camera", "--chart", "1,2,3"), "--chart takes 8 numbers with commas between them."),
        (("lamps", "--sphere", "100,100,40"), "is not the outline of a matt sphere"),
        (("lamps", "--sphere", "100,100,40", "--lights", "4"), "lights: "),
        (("flash", "--card", "14,120,9", "--camera", "Nikon D5101"), "near names are Nikon D5100"),
    ],
)
def test_bad_marks_are_one_sentence(
    calibrate: Callable[..., Any],
    chart: tuple[Path, Path],
    tmp_path: Path,
    arguments: tuple[str, ...],
    words: str,
) -> None:
    kind, *marks = arguments
    saved = tmp_path / "found.json"
    done = calibrate(kind, *chart, *LINEAR, *marks, "-o", saved)
    assert done.returncode == 2
    assert words in done.stderr
    assert done.stderr.count("\n") == 1 and "Traceback" not in done.stderr
    assert not saved.exists()


def test_a_file_that_cannot_be_written_is_said(
    calibrate: Callable[..., Any], chart: tuple[Path, Path], tmp_path: Path
) -> None:
    card = ("--card", "14,120,9", "--camera", CAMERA)
    done = calibrate("flash", *chart, *LINEAR, *card, "-o", tmp_path / "no" / "folder.json")
    assert (done.returncode, done.stdout) == (2, "")
    assert "cannot be written: no such file or directory." in done.stderr


def test_a_job_names_a_calibration(service: httpx.Client, chart: tuple[Path, Path]) -> None:
    files = [("no_flash", chart[0].read_bytes()), ("flash", chart[1].read_bytes())]
    options = {"kind": "camera", "chart": CORNERS, "flash_spectrum": "led", "exposure_ratio": 1}
    made = _finished(service, "/calibrations", files, options)
    assert made["state"] == "succeeded", made["error"]
    names = sorted(file["name"] for file in made["files"])
    assert names == ["camera.json", "manifest.json", "marks.jpg"]
    found = service.get(f"/jobs/{made['id']}/results").json()["found"]
    assert found["nearest"] == CAMERA
    table = service.get(f"/jobs/{made['id']}/results/camera.json").json()["spectral_data"]
    camera = {"camera": {"calibration": made["id"]}, "flash_spectrum": "led", "exposure_ratio": 1}
    job = _finished(service, "/jobs", files, {**camera, "lights": 1, "outputs": ["lamps.jpg"]})
    assert job["state"] == "succeeded", job["error"]
    assert job["options"]["camera"]["g"] == [row[1] for row in table["data"]["main"].values()]
    manifest = service.get(f"/jobs/{job['id']}/results").json()
    assert _unfit(manifest) == []
    rendered = {**job["options"], "encoding": "srgb"}
    again = service.post(f"/jobs/{job['id']}/rerun", json={"options": rendered}).json()
    told = _unfit(service.get(f"/jobs/{_ended(service, again)['id']}/results").json())
    assert len(told) == 1 and "found with linear files, and these are sRGB files" in told[0]
    assert manifest["camera"]["source"] == "file"
    assert manifest["lamps"][0]["cct_k"] == pytest.approx(2856, abs=100)


def test_a_calibration_that_fails_says_why(service: httpx.Client, chart: tuple[Path, Path]) -> None:
    files = [("no_flash", chart[0].read_bytes()), ("flash", chart[1].read_bytes())]
    turned = {"kind": "flash", "chart": CORNERS[2:] + CORNERS[:2], "exposure_ratio": 1}
    made = _finished(service, "/calibrations", files, {**turned, "camera": CAMERA})
    assert (made["state"], made["error"]["status"]) == ("failed", 422)
    assert "The chart is turned or mirrored" in made["error"]["detail"]


def _finished(
    service: httpx.Client, path: str, files: list[tuple[str, bytes]], options: dict[str, Any]
) -> dict[str, Any]:
    parts = [(name, (name, data)) for name, data in files]
    answer = service.post(path, files=parts, data={"options": json.dumps(options)})
    assert answer.status_code == 202, answer.text
    return _ended(service, answer.json())


def _ended(service: httpx.Client, job: dict[str, Any]) -> dict[str, Any]:
    deadline = time.monotonic() + PATIENCE_SECONDS
    while job["state"] in ("queued", "running") and time.monotonic() < deadline:
        time.sleep(0.3)
        job = service.get(job["links"]["self"]).json()
    return job

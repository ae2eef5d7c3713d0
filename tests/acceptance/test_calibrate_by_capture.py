"""Calibration by one command or request: a camera takes the pair, later jobs use what it gave."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx
import numpy as np

from drivers import capture_pair, open_camera, simulated_truth
from pipeline.spectra.lights import find_light
from pipeline.spectra.tables import parse_spectrum
from pipeline.vectors import unit

SIZE = "width=480&height=320"
CHART = f"sim://studio?scene=chart&{SIZE}"
MIRROR = f"sim://studio?scene=mirror&{SIZE}"
PATIENCE_SECONDS = 240


def _angle(power: list[float], nm: list[float]) -> float:
    grid = np.arange(420.0, 681.0, 5.0)
    ours = np.interp(grid, nm, power)
    true = np.interp(grid, np.arange(380.0, 781.0, 5.0), find_light("xenon"))
    return float(np.degrees(np.arccos(unit(ours) @ unit(true))))


def test_one_command_calibrates_and_later_separations_use_it(
    lightlayers: Callable[..., Any], tmp_path: Path
) -> None:
    def run(*arguments: object) -> str:
        kept = str(tmp_path / "kept")
        done = lightlayers(*arguments, LIGHTLAYERS_CALIBRATIONS_DIR=kept)
        assert done.returncode == 0, done.stderr
        return str(done.stdout)

    said = run("calibrate", "flash", "--camera-address", CHART, "--setup", "default")
    assert "A flash like xenon" in said
    (path,) = (tmp_path / "kept" / "default").glob("*.json")
    kept = json.loads(path.read_bytes())
    table = parse_spectrum(kept["content"].encode())
    assert _angle(table.power, table.wavelength_nm) < 2.0
    assert path.with_name(f"{path.stem}_marks.jpg").read_bytes().startswith(b"\xff\xd8")
    with open_camera(f"sim://studio?{SIZE}") as camera:
        pair = capture_pair(camera)
    files = [tmp_path / "a.dng", tmp_path / "b.dng"]
    for file, shot in zip(files, (pair.no_flash, pair.flash), strict=True):
        file.write_bytes(shot.best)
    more = ("--lights", "2", "--outputs", "lamps.jpg", "--json")
    manifest = json.loads(run("separate", *files, "-o", tmp_path / "r1", *more))
    (used,) = manifest["calibrations"]
    assert (used["kind"], used["setup"], used["made"]) == ("flash", "default", kept["made"])
    assert manifest["flash"]["source"] == "file"
    without = ("--setup", "none")
    manifest = json.loads(run("separate", *files, "-o", tmp_path / "r2", *more, *without))
    assert manifest["calibrations"] == []
    assert manifest["flash"] == {"name": "xenon", "source": "named", "flash_only": False}


def test_a_camera_without_a_chart_in_view_is_said(
    lightlayers: Callable[..., Any], tmp_path: Path
) -> None:
    flags = ("--camera-address", f"sim://studio?scene=card&{SIZE}", "-o", tmp_path / "f.json")
    done = lightlayers("calibrate", "flash", *flags)
    assert done.returncode == 2
    assert "No ColorChecker was found" in done.stderr and "give the option chart" in done.stderr
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "f.json").exists()


def _ended(service: httpx.Client, path: str, body: dict[str, Any]) -> dict[str, Any]:
    answer = service.post(path, json=body)
    assert answer.status_code == 202, answer.text
    deadline = time.monotonic() + PATIENCE_SECONDS
    job: dict[str, Any] = answer.json()
    while job["links"]["cancel"] and time.monotonic() < deadline:
        job = service.get(answer.headers["location"], headers={"Prefer": "wait=20"}).json()
    return job


def test_a_calibration_by_capture_is_the_default_of_later_jobs(service: httpx.Client) -> None:
    options = {"kind": "lamps", "mirror": True, "setup": "table"}
    made = _ended(service, "/calibrations", {"capture": {"camera": MIRROR}, "options": options})
    assert made["state"] == "succeeded", made["error"]
    assert {file["name"] for file in made["files"]} == {
        "lights.json",
        "marks.jpg",
        "manifest.json",
    }
    found = service.get(f"/jobs/{made['id']}/results/lights.json").json()["lights"]
    truth = simulated_truth(MIRROR)
    towards = unit(np.array([light["direction"] for light in found]))
    assert np.degrees(np.arccos(truth.directions @ towards.T)).min(axis=1).max() < 1.0
    said = service.get(made["links"]["results"]).json()
    assert said["warnings"] == []
    assert said["found"]["flash_aside_deg"] < 0.5
    listed = service.get("/calibrations", params={"camera": "d5100"}).json()["calibrations"]
    entry = next(one for one in listed if one["id"] == made["id"])
    assert (entry["kind"], entry["setup"]) == ("lamps", "table")
    nothing = service.get("/calibrations", params={"camera": "EOS"}).json()
    assert nothing == {"calibrations": []}
    studio = {"camera": f"sim://studio?{SIZE}"}
    wanted = {"setup": "table", "lights": 2, "outputs": ["lamps.jpg"]}
    job = _ended(service, "/jobs", {"capture": studio, "options": wanted})
    assert job["state"] == "succeeded", job["error"]
    manifest = service.get(f"/jobs/{job['id']}/results").json()
    assert [one["name"] for one in manifest["calibrations"]] == [made["id"]]
    assert manifest["options"]["light_directions"] == [
        {"strength": None, "rgb": None, **light} for light in found
    ]


def test_a_calibration_that_finds_nothing_fails_with_a_sentence(service: httpx.Client) -> None:
    body = {"capture": {"camera": CHART}, "options": {"kind": "lamps"}}
    made = _ended(service, "/calibrations", body)
    assert made["state"] == "failed"
    assert made["error"]["type"] == "urn:lightlayers:problem:nothing-to-mark"
    assert "No matt grey sphere was found" in made["error"]["detail"]

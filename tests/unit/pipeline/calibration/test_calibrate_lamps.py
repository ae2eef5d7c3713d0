"""Lamps found on spheres."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.calibration import calibrate_lamps
from pipeline.calibration.lamps_estimate import LampsEstimate
from pipeline.errors import UnusablePairError
from pipeline.options import Circle, DirectedLight
from pipeline.vectors import unit
from tests.targets import (
    CIRCLE,
    FOCAL_PX,
    Shot,
    photograph_sphere,
)
from tests.unit.pipeline.calibration.runs import (
    DIRECTIONS,
    lamps_estimate,
    let_files_say,
    run,
)


@pytest.mark.usefixtures("coarse")
def test_lamps_are_saved_as_separations_read_them(tmp_path: Path) -> None:
    shot = photograph_sphere(DIRECTIONS, np.array([(0.3, 0.2, 0.1), (0.2, 0.4, 0.3)]))
    manifest = run(shot, tmp_path, kind="lamps", sphere=CIRCLE, focal_px=FOCAL_PX, lights=2)
    lights = json.loads((tmp_path / "lights.json").read_bytes())["lights"]
    read = [DirectedLight.model_validate(light) for light in lights]
    assert np.array([light.direction for light in read]) == pytest.approx(
        DIRECTIONS[::-1], abs=0.002
    )
    assert [light.strength for light in read] == pytest.approx([1.0, 0.5], abs=0.01)
    assert [light.rgb for light in read] == [
        pytest.approx([0.5, 1, 0.75], abs=0.01),
        pytest.approx([1, 2 / 3, 1 / 3], abs=0.01),
    ]
    assert [light["deviation_deg"] < 0.1 for light in manifest["found"]["lights"]] == [True, True]
    assert manifest["found"]["flash_aside_deg"] < 0.1
    assert "flash_aside" not in [warning["code"] for warning in manifest["warnings"]]


@pytest.mark.usefixtures("coarse")
@pytest.mark.parametrize(
    ("colours", "strengths", "rgb"),
    [
        ([(0.3, 0, 0)], [None], [(1, 0.001, 0.001)]),
        ([(0.3, 0, 0), (0.6, 0, 0)], [1, 0.5], [(1, 0.001, 0.001)] * 2),
        ([(0.3, 0, 0), (0.3, 0.3, 0.3)], [1, 0.001], [(1, 1, 1), (1, 0.001, 0.001)]),
    ],
)
def test_lamps_without_green_are_calibrated(
    colours: list[tuple[float, ...]],
    strengths: list[float | None],
    rgb: list[tuple[float, ...]],
    tmp_path: Path,
) -> None:
    shot = photograph_sphere(DIRECTIONS[: len(colours)], np.array(colours))
    run(shot, tmp_path, kind="lamps", sphere=CIRCLE, focal_px=FOCAL_PX, lights=len(colours))
    lights = json.loads((tmp_path / "lights.json").read_bytes())["lights"]
    read = [DirectedLight.model_validate(light) for light in lights]
    if len(set(rgb)) < len(rgb):  # lamps of one colour come in either order
        read.sort(key=lambda light: -(light.strength or 0.0))
    assert [light.strength for light in read] == [
        one and pytest.approx(one, rel=0.02) for one in strengths
    ]
    assert [light.rgb for light in read] == [pytest.approx(one, rel=0.02) for one in rgb]


@pytest.mark.usefixtures("coarse")
def test_a_lamp_alone_is_not_said_to_be_as_strong_as_others_of_other_files(tmp_path: Path) -> None:
    """Put together, both would else be of strength 1, whatever their light."""
    put_together = []
    for direction, brightness in zip(DIRECTIONS, (0.4, 0.05), strict=True):
        shot = photograph_sphere(direction[None], np.array([(0.3, 1.0, 0.1)]) * brightness)
        manifest = run(shot, tmp_path, kind="lamps", sphere=CIRCLE, focal_px=FOCAL_PX, lights=1)
        assert "strength" not in manifest["found"]["lights"][0]
        put_together += json.loads((tmp_path / "lights.json").read_bytes())["lights"]
    read = [DirectedLight.model_validate(light) for light in put_together]
    assert [light.strength for light in read] == [None, None]
    assert [light.rgb for light in read] == [pytest.approx((0.3, 1.0, 0.1), abs=0.01)] * 2


@pytest.mark.usefixtures("coarse")
def test_a_flash_far_beside_and_an_unknown_lens_are_warned_of(tmp_path: Path) -> None:
    shot = photograph_sphere(DIRECTIONS[:1], np.array([(0.3, 0.2, 0.1)]), flash_at=(0.12, 0.0))
    warnings = run(shot, tmp_path, kind="lamps", sphere=CIRCLE, lights=1)["warnings"]
    said = {warning["code"]: warning["message"] for warning in warnings}
    assert said["flash_aside"].startswith("The flash shines from 7° beside")
    assert said["focal_length_assumed"].startswith("The focal length is not known")


@pytest.mark.parametrize(
    ("setup", "count", "warned"), [("table", 1, True), ("table", 2, False), (None, 1, False)]
)
def test_one_lamp_that_is_kept_is_warned_of(
    ball: Shot,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    setup: str | None,
    count: int,
    warned: bool,
) -> None:
    """In a file it may go together with others."""
    few = {
        "directions": DIRECTIONS[:count],
        "colours": np.ones((count, 3)),
        "deviations_deg": np.ones(count),
    }
    monkeypatch.setattr(calibrate_lamps, "matt_lamps", lambda *_: lamps_estimate(**few))
    let_files_say(monkeypatch, {"model": "D5100"})
    warnings = run(ball, tmp_path, kind="lamps", sphere=CIRCLE, setup=setup)["warnings"]
    said = [one["message"] for one in warnings if one["code"] == "kept_unusable"]
    assert len(said) == warned
    assert all("kept for the set-up 'table' will be left out" in message for message in said)


def test_lamps_are_told_by_the_strongest_of_them_and_of_their_channels(
    ball: Shot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One without green still shines: as much of it is told as normals then take."""
    asked: list[Any] = []

    def estimate(*given: Any) -> LampsEstimate:
        asked[:] = given[1:]
        return lamps_estimate()

    monkeypatch.setattr(calibrate_lamps, "matt_lamps", estimate)
    marked = {"kind": "lamps", "sphere": CIRCLE, "lights": 2, "focal_px": FOCAL_PX}
    found = run(ball, tmp_path / "new" / "folder", **marked)["found"]

    assert asked == [Circle(**CIRCLE), 2, FOCAL_PX]
    assert [light["strength"] for light in found["lights"]] == [1.0, 0.001]
    assert [light["rgb"] for light in found["lights"]] == [[0.25, 1.0, 0.5], [1.0, 0.001, 0.1]]
    assert [light["deviation_deg"] for light in found["lights"]] == [0.123, 0.5]
    assert found["sphere"] == {"x": 196.12, "y": 112.46, "radius": 62.79}
    assert (found["flash_aside_deg"], found["misfit"]) == (1.23, 0.0123)


@pytest.mark.parametrize("mirror", [False, True])
def test_lamps_that_fix_no_normals_are_refused(
    ball: Shot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, mirror: bool
) -> None:
    """Kept, they would make all later separations fail."""
    flat = unit(np.array([(-0.7, 0, 0.7), (0, 0, 1.0), (0.7, 0, 0.7)]))
    found = lamps_estimate(directions=flat, colours=np.ones((3, 3)), deviations_deg=np.ones(3))
    for name in ("matt_lamps", "mirror_lamps"):
        monkeypatch.setattr(calibrate_lamps, name, lambda *_: found)

    marked = {"kind": "lamps", "mirror": mirror, "sphere": CIRCLE, "focal_px": FOCAL_PX}
    with pytest.raises(UnusablePairError, match=r"The 3 lamps found .* fixes no normals"):
        run(ball, tmp_path / "out", **marked)

    assert not (tmp_path / "out").exists()


def test_what_a_mirror_does_not_tell_is_left_out(
    ball: Shot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    unknown = lamps_estimate(misfit=None, flash_aside_deg=None)
    monkeypatch.setattr(calibrate_lamps, "mirror_lamps", lambda *_: unknown)
    marked = {"kind": "lamps", "mirror": True, "sphere": CIRCLE, "focal_px": FOCAL_PX}
    manifest = run(ball, tmp_path, **marked)
    assert set(manifest["found"]) == {"lights", "sphere"}
    assert "flash_aside" not in [warning["code"] for warning in manifest["warnings"]]


@pytest.mark.parametrize(("aside_deg", "warned"), [(4.9, False), (5.1, True)])
def test_a_flash_may_be_five_degrees_beside(
    ball: Shot,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    aside_deg: float,
    warned: bool,
) -> None:
    monkeypatch.setattr(
        calibrate_lamps, "matt_lamps", lambda *_: lamps_estimate(flash_aside_deg=aside_deg)
    )
    warnings = run(ball, tmp_path, kind="lamps", sphere=CIRCLE)["warnings"]
    figures = [said["figures"] for said in warnings if said["code"] == "flash_aside"]
    assert figures == ([{"angle_deg": aside_deg}] if warned else [])


@pytest.mark.parametrize("one_more", [True, False])
def test_one_lamp_more_than_were_told_is_warned_of(
    ball: Shot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, one_more: bool
) -> None:
    monkeypatch.setattr(calibrate_lamps, "matt_lamps", lambda *_: lamps_estimate(one_more=one_more))
    warnings = run(ball, tmp_path, kind="lamps", sphere=CIRCLE)["warnings"]
    figures = [said["figures"] for said in warnings if said["code"] == "unexplained"]
    assert figures == ([{"misfit": 0.0123}] if one_more else [])

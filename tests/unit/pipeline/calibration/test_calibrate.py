from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.calibration import calibrate as module
from pipeline.calibration.calibrate import calibrate_files
from pipeline.calibration.lamps import LampsEstimate
from pipeline.calibration.marks import disc
from pipeline.calibration.options import CALIBRATION_OPTIONS, FILES
from pipeline.colour.temperature import cct_duv
from pipeline.decode import decode
from pipeline.errors import Canceled, InputError, OptionError, UnusablePairError
from pipeline.options import Circle, DirectedLight
from pipeline.progress import Progress
from pipeline.spectra.cameras import Camera
from pipeline.spectra.colorchecker import colorchecker_spectra
from pipeline.spectra.lights import find_light
from pipeline.spectra.observer import cie_1931
from pipeline.spectra.tables import parse_sensitivities, parse_spectrum
from pipeline.taken_with import TakenWith
from pipeline.vectors import unit
from tests.targets import (
    CIRCLE,
    CORNERS,
    FOCAL_PX,
    Shot,
    photograph_sphere,
)
from tests.unit.pipeline.calibration.runs import LED, S, run

DIRECTIONS = unit(np.array([(-0.9, 0.3, 0.2), (0.7, -0.5, 0.4)]))


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


def test_the_manifest_tells_the_photographs_and_what_was_assumed(
    chart: Shot, tmp_path: Path
) -> None:
    card = {"x": 14, "y": 120, "radius": 12}
    manifest = run(chart, tmp_path, kind="flash", card=card, exposure_ratio=None)
    for name, data in zip(("no_flash", "flash"), chart.files, strict=True):
        assert manifest["inputs"][name]["sha256"] == hashlib.sha256(data).hexdigest()
    assert "exposure_assumed" in [warning["code"] for warning in manifest["warnings"]]
    assert "exposure_assumed" not in [
        warning["code"] for warning in run(chart, tmp_path, kind="flash", card=card)["warnings"]
    ]


def test_a_flash_like_no_light_has_no_temperature(chart: Shot, tmp_path: Path) -> None:
    """Of a camera that takes green for the other channels, too."""
    green = np.array([S[1] * gain for gain in (0.2, 1.0, 0.2)]) + 0.3 * S
    nm = [380.0 + 5 * i for i in range(81)]
    table = {"wavelength_nm": nm, **dict(zip("rgb", green.tolist(), strict=True))}
    card = {"x": 14, "y": 120, "radius": 12}
    found = run(chart, tmp_path, kind="flash", card=card, camera=table)["found"]
    assert (found["cct_k"], found["duv"]) == (None, None)


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
    monkeypatch.setattr(module, "find_camera", lambda *_: own)
    found = run(chart, tmp_path, kind="camera", chart=CORNERS, flash_spectrum="led")["found"]
    assert found["known_cameras"] == 3


def test_what_is_no_pair_is_refused(chart: Shot, tmp_path: Path) -> None:
    no_flash, flash = chart.files
    for files, error, words in (
        ((no_flash, no_flash), UnusablePairError, "photographs are identical"),
        ((no_flash, b""), InputError, "photograph with the flash"),
        ((no_flash[:1000], flash), InputError, "photograph without the flash"),
        ((no_flash, flash[:300_000]), InputError, "photograph with the flash"),
    ):
        with pytest.raises(error, match=words):
            run(Shot(chart.frames, files), tmp_path, kind="camera", chart=CORNERS)
    assert list(tmp_path.iterdir()) == []


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
    monkeypatch.setattr(module, "matt_lamps", lambda *_: _lamps(**few))
    monkeypatch.setattr(module, "decode", lambda *those: replace(decode(*those), model="D5100"))
    warnings = run(ball, tmp_path, kind="lamps", sphere=CIRCLE, setup=setup)["warnings"]
    said = [one["message"] for one in warnings if one["code"] == "kept_unusable"]
    assert len(said) == warned
    assert all("kept for the set-up 'table' will be left out" in message for message in said)


@pytest.mark.parametrize("kind", ["flash", "camera", "lamps"])
def test_nothing_is_kept_for_a_camera_that_is_not_known(
    chart: Shot, tmp_path: Path, kind: str
) -> None:
    """No separation would ever use it."""
    with pytest.raises(OptionError, match=r"of which camera they are.*: leave the set-up out"):
        run(chart, tmp_path, kind=kind, setup="default")
    assert list(tmp_path.iterdir()) == []


def _lamps(**more: Any) -> LampsEstimate:
    given: dict[str, Any] = {
        "directions": DIRECTIONS,
        "colours": np.array([[0.2, 0.8, 0.4], [0.8, 0.0, 0.08]]),
        "deviations_deg": np.array([0.12345, 0.5]),
        "misfit": 0.01234,
        "circle": Circle(x=196.123, y=112.456, radius=62.789),
        "flash_aside_deg": 1.234,
    }
    return LampsEstimate(**{**given, **more})


@pytest.fixture(scope="module")
def ball() -> Shot:
    return photograph_sphere(DIRECTIONS[:1], np.array([(0.3, 0.2, 0.1)]))


def test_lamps_are_told_by_the_strongest_of_them_and_of_their_channels(
    ball: Shot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One without green still shines: as much of it is told as normals then take."""
    asked: list[Any] = []

    def estimate(*given: Any) -> LampsEstimate:
        asked[:] = given[1:]
        return _lamps()

    monkeypatch.setattr(module, "matt_lamps", estimate)
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
    found = _lamps(directions=flat, colours=np.ones((3, 3)), deviations_deg=np.ones(3))
    for name in ("matt_lamps", "mirror_lamps"):
        monkeypatch.setattr(module, name, lambda *_: found)

    marked = {"kind": "lamps", "mirror": mirror, "sphere": CIRCLE, "focal_px": FOCAL_PX}
    with pytest.raises(UnusablePairError, match=r"The 3 lamps found .* fixes no normals"):
        run(ball, tmp_path / "out", **marked)

    assert not (tmp_path / "out").exists()


def test_what_a_mirror_does_not_tell_is_left_out(
    ball: Shot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    unknown = _lamps(misfit=None, flash_aside_deg=None)
    monkeypatch.setattr(module, "mirror_lamps", lambda *_: unknown)
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
    monkeypatch.setattr(module, "matt_lamps", lambda *_: _lamps(flash_aside_deg=aside_deg))
    warnings = run(ball, tmp_path, kind="lamps", sphere=CIRCLE)["warnings"]
    figures = [said["figures"] for said in warnings if said["code"] == "flash_aside"]
    assert figures == ([{"angle_deg": aside_deg}] if warned else [])


@pytest.mark.parametrize("one_more", [True, False])
def test_one_lamp_more_than_were_told_is_warned_of(
    ball: Shot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, one_more: bool
) -> None:
    monkeypatch.setattr(module, "matt_lamps", lambda *_: _lamps(one_more=one_more))
    warnings = run(ball, tmp_path, kind="lamps", sphere=CIRCLE)["warnings"]
    figures = [said["figures"] for said in warnings if said["code"] == "unexplained"]
    assert figures == ([{"misfit": 0.0123}] if one_more else [])


def test_a_wrong_camera_is_noticed(chart: Shot, tmp_path: Path) -> None:
    red_for_blue = {"wavelength_nm": [380.0 + 5 * i for i in range(81)]}
    table = {**red_for_blue, "r": S[2].tolist(), "g": S[1].tolist(), "b": S[0].tolist()}
    with pytest.raises(UnusablePairError, match="check the marks and the camera"):
        run(chart, tmp_path, kind="flash", chart=CORNERS, camera=table)


@pytest.mark.parametrize("kind", ["flash", "camera", "lamps"])
def test_what_is_found_says_what_it_was_found_with(
    chart: Shot, ball: Shot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: Any
) -> None:
    said: Any = {"make": "NIKON", "model": "D5100", "serial": "6001234", "orientation": 3}
    monkeypatch.setattr(module, "decode", lambda *those: replace(decode(*those), **said))
    monkeypatch.setattr(module, "matt_lamps", lambda *_: _lamps())
    marks = {"lamps": {"sphere": CIRCLE}}.get(kind, {"chart": CORNERS})
    manifest = run(ball if kind == "lamps" else chart, tmp_path, kind=kind, **marks)

    content = json.loads((tmp_path / FILES[kind]).read_bytes())
    for saved in content["lights"] if kind == "lamps" else [content]:
        assert saved["taken_with"] == manifest["taken_with"]
    taken_with = TakenWith.model_validate(manifest["taken_with"])
    assert (taken_with.model, taken_with.encoding) == ("D5100", "linear")
    assert (taken_with.orientation, taken_with.upright) == (3, False)
    assert b"6001234" not in (tmp_path / FILES[kind]).read_bytes()


@pytest.mark.parametrize(("encoding", "warned"), [("raw", True), ("linear", False)])
def test_a_named_camera_that_does_not_fit_is_used_and_told(
    chart: Shot, tmp_path: Path, encoding: str, warned: bool
) -> None:
    nm = [380.0 + 5 * i for i in range(81)]
    table = {"wavelength_nm": nm, **dict(zip("rgb", S.tolist(), strict=True))}
    camera = {**table, "taken_with": {"encoding": encoding}}
    card = {"x": 14, "y": 120, "radius": 12}

    manifest = run(chart, tmp_path, kind="flash", card=card, camera=camera)

    assert manifest["found"]["camera"]["source"] == "file"
    codes = [warning["code"] for warning in manifest["warnings"]]
    assert ("calibration_unfit" in codes) is warned


@pytest.mark.parametrize("full", ["flash.json", "marks.jpg"])
def test_a_run_that_fails_while_it_writes_leaves_no_manifest_of_the_run_before(
    chart: Shot, tmp_path: Path, full: str
) -> None:
    card = {"x": 14, "y": 120, "radius": 12}
    run(chart, tmp_path, kind="flash", card=card)
    with pytest.raises(OptionError):  # refused: what was found before is whole
        run(chart, tmp_path, kind="flash", card={**card, "x": 9000})
    assert (tmp_path / "manifest.json").exists()
    (tmp_path / full).unlink()
    (tmp_path / full).mkdir()  # cannot be written
    with pytest.raises(OSError, match="directory"):
        run(chart, tmp_path, kind="flash", card=card)
    assert not (tmp_path / "manifest.json").exists()


def test_progress_tells_its_stages_and_may_stop(chart: Shot, tmp_path: Path) -> None:
    told: list[tuple[str, float]] = []
    options = CALIBRATION_OPTIONS.validate_python(
        {"kind": "flash", "card": {"x": 14, "y": 120, "radius": 12}, "encoding": "linear"}
    )
    progress = Progress(lambda stage, fraction: told.append((stage, fraction)))
    calibrate_files(*chart.files, options, tmp_path, progress)
    assert list(dict.fromkeys(stage for stage, _ in told)) == ["decode", "align", "calibrate"]
    assert told[:3] == [("decode", 0.0), ("decode", 0.5), ("decode", 1.0)]
    assert told[-2:] == [("calibrate", 0.0), ("calibrate", 1.0)]
    stop = Progress(canceled=lambda: True)
    with pytest.raises(Canceled):
        calibrate_files(*chart.files, options, tmp_path / "other", stop)
    assert not (tmp_path / "other").exists()


def test_every_kind_has_its_file() -> None:
    assert FILES == {"flash": "flash.json", "camera": "camera.json", "lamps": "lights.json"}

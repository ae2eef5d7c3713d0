from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import pytest

from pipeline.calibration import calibrate_lamps
from pipeline.calibration.calibrate import calibrate_files
from pipeline.calibration.options import CALIBRATION_OPTIONS, FILES
from pipeline.errors import Canceled, InputError, OptionError, UnusablePairError
from pipeline.progress import Progress
from pipeline.taken_with import TakenWith
from tests.targets import (
    CIRCLE,
    CORNERS,
    Shot,
)
from tests.unit.pipeline.calibration.runs import (
    S,
    lamps_estimate,
    let_files_say,
    run,
)


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


@pytest.mark.parametrize("kind", ["flash", "camera", "lamps"])
def test_nothing_is_kept_for_a_camera_that_is_not_known(
    chart: Shot, tmp_path: Path, kind: str
) -> None:
    """No separation would ever use it."""
    with pytest.raises(OptionError, match=r"of which camera they are.*: leave the set-up out"):
        run(chart, tmp_path, kind=kind, setup="default")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("kind", ["flash", "camera", "lamps"])
def test_what_is_found_says_what_it_was_found_with(
    chart: Shot, ball: Shot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: Any
) -> None:
    said: Any = {"make": "NIKON", "model": "D5100", "serial": "6001234", "orientation": 3}
    let_files_say(monkeypatch, said)
    monkeypatch.setattr(calibrate_lamps, "matt_lamps", lambda *_: lamps_estimate())
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

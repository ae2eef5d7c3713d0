from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import pytest

from pipeline.calibration.flash_spectrum import FAMILY
from pipeline.spectra.lights import find_light
from tests.evaluation import calibrated, calibration
from tests.evaluation.calibrated import Assumed, cameras, flashes, ways
from tests.evaluation.calibration import Figure, measure, rows
from tests.evaluation.capture import Capture
from tests.evaluation.scenes import neutral_seen, render_seen, scenes
from tests.evaluation.spectra import sensitivities
from tests.evaluation.spheres import SphereFigure, sphere_rows
from tests.layers import Planes
from tests.targets import CORNERS, Shot

SMALL = (64, 48)


def _cosines(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.asarray(
        (a * b).sum(axis=-1) / np.linalg.norm(a, axis=-1) / np.linalg.norm(b, axis=-1)
    )


def test_flashes_are_none_that_calibration_knows() -> None:
    family = np.array([find_light(name) for name in FAMILY])
    for flash in [*flashes("development", 6), *flashes("report", 6)]:
        assert abs(flash.sum() - 1) < 1e-9
        assert _cosines(family, flash).max() < np.cos(np.radians(2))


def test_cameras_are_as_far_from_the_assumed_one_as_measured_ones_are() -> None:
    degrees = [
        np.degrees(np.arccos(_cosines(camera, sensitivities("Nikon D5100")))).mean()
        for camera in [*cameras("development", 6), *cameras("report", 6)]
    ]
    assert 6 < np.median(degrees) < 13
    assert np.array_equal(cameras("report", 6), cameras("report", 6))


def known(told: dict[str, Any]) -> dict[str, Any]:
    """What is told, the true curves as "true"."""
    return {name: "true" if hasattr(one, "wavelength_nm") else one for name, one in told.items()}


def test_the_ways_tell_what_is_known_and_calibrate_the_rest(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: list[tuple[str, dict[str, Any]]] = []

    def calibrate(kind: str, _shot: Shot, **marks: Any) -> Assumed:
        asked.append((kind, known(marks)))
        return {{"camera": "camera", "flash": "flash_spectrum"}[kind]: f"found {kind}"}

    def told(unknown: str) -> dict[str, dict[str, Any]]:
        asked.clear()
        chart = Shot((np.zeros(0), np.zeros(0)), (b"", b""))
        found = ways(unknown, chart, sensitivities("Nikon D5100"), find_light("led"))
        return {name: known(dict(way())) for name, way in found.items()}

    monkeypatch.setattr(calibrated, "calibrate", calibrate)
    true, corners = {"camera": "true", "flash_spectrum": "true"}, {"chart": CORNERS}
    card = {"x": 14.0, "y": 120.0, "radius": 12.0}

    assert told("flash") == {
        "assumed": {**true, "flash_spectrum": "xenon"},
        "grey card": {**true, "flash_spectrum": "found flash"},
        "ColorChecker": {**true, "flash_spectrum": "found flash"},
        "true": true,
    }
    assert asked == [
        ("flash", {"card": card, "camera": "true"}),
        ("flash", {**corners, "camera": "true"}),
    ]
    assert told("camera") == {
        "assumed": {**true, "camera": "Nikon D5100"},
        "ColorChecker": {**true, "camera": "found camera"},
        "ColorChecker, flash not told": {**true, "camera": "found camera"},
        "true": true,
    }
    assert asked == [("camera", {**corners, "flash_spectrum": "true"}), ("camera", corners)]
    assert told("both") == {
        "assumed": {"camera": "Nikon D5100", "flash_spectrum": "xenon"},
        "ColorChecker": {"camera": "found camera", "flash_spectrum": "found flash"},
        "true": true,
    }
    assert asked == [("camera", corners), ("flash", {**corners, "camera": "found camera"})]


def test_a_figure_is_of_the_layers_by_either_method_and_of_the_white_balance(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    s, flash = sensitivities("Nikon D5100"), find_light("led")
    scene = scenes("two", "development")[1]
    lit = render_seen(scene, s, flash, SMALL).lamps
    neutral = neutral_seen(scene, s, lit, SMALL)

    def separated(taken: Capture, assumed: Assumed) -> Planes | None:
        if "known" not in assumed:
            return None
        share = {"best": 0.9, "paper": 0.99}[assumed["method"]]
        pictures = {"lamp1.": share * taken.truth[1], "lamp2.": share * taken.truth[0]}
        pictures[""] = neutral if assumed["method"] == "best" else taken.truth[0]
        return {
            f"{prefix}{name}": shown[..., at]
            for prefix, shown in pictures.items()
            for at, name in enumerate("RGB")
        }

    monkeypatch.setattr(calibration, "render_seen", partial(render_seen, size=SMALL))
    monkeypatch.setattr(calibration, "neutral_seen", partial(neutral_seen, size=SMALL))
    monkeypatch.setattr(calibration, "_separated", separated)
    monkeypatch.setattr(
        calibration, "ways", lambda *_: {"nothing": dict, "all": lambda: {"known": True}}
    )

    refused, exact = measure("development", "both", 1, s, flash)

    assert refused == Figure("development", "both", scene.name, "nothing", 0.0, 0.0, 20.0)
    assert (exact.scene, exact.assumed) == (scene.name, "all")
    assert exact.snr_db == pytest.approx(20.0, abs=1e-3)
    assert exact.paper_db == pytest.approx(40.0, abs=1e-3)
    assert exact.colour_deg == pytest.approx(0.0, abs=1e-3)


def test_rows_give_the_median_and_the_worst() -> None:
    found = [
        Figure("report", "flash", str(n), "true", snr, snr / 2, 1 / snr)
        for n, snr in enumerate((10.0, 20.0, 50.0))
    ]
    assert rows(found, "report")[1] == [
        "flash", "true", "20.0 / 10.0", "10.0 / 5.0", "0.05 / 0.10"
    ]  # fmt: skip
    assert rows(found, "development")[1:] == []


def test_spheres_that_were_refused_or_miscounted_are_told() -> None:
    found = [
        SphereFigure("report", 2, True, 1.0, 2),
        SphereFigure("report", 2, True, 3.0, 2),
        SphereFigure("report", 2, True, None, 0),
        SphereFigure("report", 2, True, None, 3),
    ]
    assert sphere_rows(found, "report")[1] == ["2", "of a sensor", "4", "1", "1", "2.00 / 3.00"]

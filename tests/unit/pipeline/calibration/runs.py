"""Calibrations of simulated photographs, as linear files of one exposure."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.calibration import calibrate
from pipeline.calibration.calibrate import calibrate_files
from pipeline.calibration.lamps_estimate import LampsEstimate
from pipeline.calibration.options import CALIBRATION_OPTIONS
from pipeline.decode import decode
from pipeline.options import Circle
from pipeline.progress import Progress
from pipeline.spectra.lights import find_light
from pipeline.vectors import unit
from tests.evaluation.spectra import sensitivities
from tests.targets import Shot

DIRECTIONS = unit(np.array([(-0.9, 0.3, 0.2), (0.7, -0.5, 0.4)]))
S, LED, LAMP = sensitivities("Nikon D5100"), find_light("led"), find_light("A")


def run(shot: Shot, folder: Path, **options: Any) -> dict[str, Any]:
    """Calibrate; options: kind, marks and whatever else is given. Returns the manifest.

    Photographs lie as they are, which takes half the time.
    """
    given = {"encoding": "linear", "exposure_ratio": 1.0, "align": False, **options}
    return calibrate_files(
        *shot.files, CALIBRATION_OPTIONS.validate_python(given), folder, Progress()
    )


def lamps_estimate(**more: Any) -> LampsEstimate:
    """What a sphere could have told, but for what is given."""
    given: dict[str, Any] = {
        "directions": DIRECTIONS,
        "colours": np.array([[0.2, 0.8, 0.4], [0.8, 0.0, 0.08]]),
        "deviations_deg": np.array([0.12345, 0.5]),
        "misfit": 0.01234,
        "circle": Circle(x=196.123, y=112.456, radius=62.789),
        "flash_aside_deg": 1.234,
    }
    return LampsEstimate(**{**given, **more})


def of_the_flash(manifest: dict[str, Any]) -> list[str]:
    """What is said of a doubtful flash."""
    warnings = manifest["warnings"]
    return [warning["message"] for warning in warnings if warning["code"] == "flash_doubtful"]


def let_files_say(monkeypatch: pytest.MonkeyPatch, facts: dict[str, Any]) -> None:
    """Have the photographs of a calibration say these facts of themselves."""
    monkeypatch.setattr(calibrate, "decode", lambda *those: replace(decode(*those), **facts))

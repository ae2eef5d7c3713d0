"""Calibrations of simulated photographs, as linear files of one exposure."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pipeline.calibration.calibrate import calibrate_files
from pipeline.calibration.options import CALIBRATION_OPTIONS
from pipeline.progress import Progress
from pipeline.spectra.lights import find_light
from tests.evaluation.spectra import sensitivities
from tests.targets import Shot

S, LED, LAMP = sensitivities("Nikon D5100"), find_light("led"), find_light("A")


def run(shot: Shot, folder: Path, **options: Any) -> dict[str, Any]:
    """Calibrate; options: kind, marks and whatever else is given. Returns the manifest."""
    given = {"encoding": "linear", "exposure_ratio": 1.0, **options}
    return calibrate_files(
        *shot.files, CALIBRATION_OPTIONS.validate_python(given), folder, Progress()
    )

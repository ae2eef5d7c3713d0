from __future__ import annotations

import numpy as np

from pipeline.calibration.flash import FAMILY
from pipeline.spectra.lights import find_light
from tests.evaluation.calibrated import cameras, flashes
from tests.evaluation.calibration import Figure, rows
from tests.evaluation.spectra import sensitivities
from tests.evaluation.spheres import SphereFigure, sphere_rows


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

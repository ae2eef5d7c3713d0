"""Separations, calibrations and mixes as tasks."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import pytest

from pipeline.calibration.options import FlashCalibration
from service.errors import OlderWorkerError
from service.workers import child, pair_tasks
from service.workers.tasks import RESULTS, Limits, Task

GIB = 2**30


@pytest.mark.parametrize(
    ("kind", "options", "place"),
    [
        ("separate", {"of_tomorrow": 1}, "of_tomorrow"),
        (
            "calibrate",
            {"kind": "flash", "card": {"x": 1, "y": 1, "radius": 5}, "of_tomorrow": 1},
            "flash.of_tomorrow",
        ),
        ("mix", {"mix": {"lamps": [{}], "of_tomorrow": 1}}, "of_tomorrow"),
    ],
)
def test_options_of_a_newer_service_are_told(
    kind: Literal["separate", "calibrate", "mix"],
    options: dict[str, Any],
    place: str,
    tmp_path: Path,
) -> None:
    """An API that was upgraded before its workers takes what they do not know yet."""
    _photographs(tmp_path, b"", b"")
    task = Task(kind, "7", "f" * 32, str(tmp_path), Limits(100, GIB, 60, 256, GIB), options)
    with pytest.raises(OlderWorkerError) as caught:
        pair_tasks.WORK[kind](task, lambda _message: None)
    assert str(caught.value) == (
        f"{place}: this name is not known; the workers are older than the service that took the "
        "job: have its operator upgrade them, then run the job again."
    )
    problem = child._explain(caught.value, task)
    assert (problem["type"], problem["retryable"]) == ("urn:lightlayers:problem:older-worker", True)


def _photographs(directory: Path, no_flash: bytes, flash: bytes) -> None:
    (directory / "no_flash").write_bytes(no_flash)
    (directory / "flash").write_bytes(flash)


def test_a_calibration_reads_its_photographs_and_writes_where_results_are_looked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given: list[Any] = []
    monkeypatch.setattr(pair_tasks, "calibrate_files", lambda *arguments: given.extend(arguments))
    _photographs(tmp_path, b"dark", b"lit")
    limits = Limits(100, 8 * GIB, 60, 256, 4 * GIB)
    told: list[dict[str, Any]] = []
    task = Task("calibrate", "7", "f" * 32, str(tmp_path), limits, {"kind": "flash"})
    pair_tasks.WORK["calibrate"](task, told.append)
    assert given[:2] == [b"dark", b"lit"]
    assert isinstance(given[2], FlashCalibration)
    assert given[3] == tmp_path / RESULTS
    given[4].report("calibrate", 0.5)
    assert told == [{"stage": "calibrate", "fraction": 0.5}]

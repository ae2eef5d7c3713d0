from __future__ import annotations

import os
from pathlib import Path

import pytest

from drivers import SettingName
from service.settings import Settings
from service.workers.tasks import (
    Adjust,
    CameraOrder,
    FindCameras,
    Kind,
    Limits,
    LookAt,
    TakePair,
    Task,
    results_of,
)

LIMITS = Limits(
    seconds=60, memory_bytes=2**30, cpu_seconds=10, open_files=64, output_bytes=1_000_000
)


@pytest.mark.parametrize(
    ("kind", "order"),
    [
        ("separate", None),
        ("capture", TakePair("sim://studio", "external", {SettingName.ISO: 400}, switch="w {s}")),
        ("cameras", FindCameras(network=True)),
        ("camera", LookAt("sim://studio")),
        ("camera_settings", Adjust("sim://studio", {SettingName.F_NUMBER: 8})),
    ],
)
def test_a_task_is_read_as_it_was_written(kind: Kind, order: CameraOrder | None) -> None:
    task = Task(kind, "7", "trace", "folder", LIMITS, {"lights": 2}, order)
    assert "\n" not in task.to_json()
    assert Task.from_json(task.to_json()) == task


def test_results_are_the_files_of_the_folder_by_name(tmp_path: Path) -> None:
    results = tmp_path / "results"
    (results / "folder").mkdir(parents=True)
    for name in ("manifest.json", "lamp1.jpg"):
        (results / name).write_bytes(b"")
    assert [path.name for path in results_of(tmp_path)] == ["lamp1.jpg", "manifest.json"]


def test_limits_are_those_of_the_settings(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "cpu_count", lambda: 4)
    settings = Settings(job_memory_bytes=2**30, job_open_files=16, job_output_bytes=2**24)
    assert Limits.of(settings, 10) == Limits(10, 2**30, 41, 16, 2**24)

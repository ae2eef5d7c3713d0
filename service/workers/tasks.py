"""What the process of a task is to do, as it is told on its stdin."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

from drivers import SettingName
from service.capture import FlashStrategy, SettingValue
from service.settings import Settings

RESULTS = "results"
"""The folder of a task's directory in which it lays what it makes."""

PAIRS = "pairs"
"""Argument of the fork server's program where tasks separate, calibrate or mix."""

Tell = Callable[[dict[str, Any]], None]
"""Writes a message of a task to the service, as service.workers.child says."""

Kind = Literal[
    "check", "separate", "calibrate", "mix", "capture", "cameras", "camera", "camera_settings"
]


@dataclass(frozen=True)
class Limits:
    """What a process may use.

    seconds: from its beginning on, but for the time that its questions take. cpu_seconds: of all
    processors. output_bytes: in its whole folder.
    """

    seconds: float
    memory_bytes: int
    cpu_seconds: int
    open_files: int
    output_bytes: int

    @classmethod
    def of(cls, settings: Settings, seconds: float) -> Limits:
        """Those of the settings, for a task that may run for so many seconds on all processors."""
        return cls(
            seconds=seconds,
            memory_bytes=settings.job_memory_bytes,
            cpu_seconds=int(seconds * (os.cpu_count() or 1)) + 1,
            open_files=settings.job_open_files,
            output_bytes=settings.job_output_bytes,
        )


@dataclass(frozen=True)
class TakePair:
    """How a camera is to take a pair: as a request asks, and as the operator has set it up."""

    camera: str
    flash: FlashStrategy = "property"
    settings: dict[SettingName, SettingValue] = field(default_factory=dict)
    keep: bool = True
    switch: str | None = None
    settle_seconds: float = 0.0
    operator_seconds: float = 0.0


@dataclass(frozen=True)
class FindCameras:
    """Which cameras to find: those here; network: also those that announce themselves there."""

    network: bool


@dataclass(frozen=True)
class LookAt:
    """The address of a camera to look at."""

    camera: str


@dataclass(frozen=True)
class Adjust:
    """Settings of a camera to write, by name."""

    camera: str
    settings: dict[SettingName, SettingValue]


CameraOrder = TakePair | FindCameras | LookAt | Adjust

_ORDERS: dict[Kind, type[CameraOrder]] = {
    "capture": TakePair,
    "cameras": FindCameras,
    "camera": LookAt,
    "camera_settings": Adjust,
}


@dataclass(frozen=True)
class Task:
    """What a process is to do.

    kind "check": the headers of directory/no_flash and directory/flash.
    kind "separate": directory/no_flash and directory/flash, with options → directory/RESULTS.
    kind "calibrate": the same, with the options of a calibration.
    kind "mix": directory/layers.exr and directory/manifest.json, with the options of a mix →
        directory/RESULTS.
    kind "capture": TakePair → directory/no_flash and directory/flash; asks the questions of
        service.workers.camera_tasks, and answers with what the camera was set to.
    kind "cameras": FindCameras; answers with the addresses of all that are found.
    kind "camera": LookAt; answers with what the camera tells of itself, and whether it can be
        released.
    kind "camera_settings": Adjust; answers with all settings that the camera has.
    """

    kind: Kind
    job: str
    trace_id: str
    directory: str
    limits: Limits
    options: dict[str, Any]
    camera: CameraOrder | None = None

    @classmethod
    def from_json(cls, text: str) -> Task:
        """Read what to_json has written."""
        values = json.loads(text)
        order = values["camera"] and _ORDERS[values["kind"]](**values["camera"])
        return cls(**{**values, "limits": Limits(**values["limits"]), "camera": order})

    def to_json(self) -> str:
        """Write the task as one line."""
        return json.dumps(asdict(self))

    def photograph(self, name: str) -> bytes:
        """Read the photograph "no_flash" or "flash" in the directory. Raises OSError."""
        return (Path(self.directory) / name).read_bytes()


def results_of(directory: Path) -> list[Path]:
    """List the files that a "separate", "calibrate" or "mix" task wrote, by name."""
    return sorted(path for path in (directory / RESULTS).iterdir() if path.is_file())

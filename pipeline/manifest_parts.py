"""What the manifests of all kinds of runs have in common, and the writing of one."""

from __future__ import annotations

import json
from importlib.metadata import version
from pathlib import Path
from typing import Any

from pipeline.images.frames import Frame
from pipeline.result_names import MANIFEST

_LIBRARIES = ("numpy", "opencv-python-headless", "scipy", "colour-science", "rawpy")


def input_entry(frame: Frame) -> dict[str, Any]:
    """What is said of a photograph: its digest, size and exposure, and nothing of its place."""
    width, height = frame.size
    return {
        "sha256": frame.sha256,
        "width": width,
        "height": height,
        "encoding": frame.encoding,
        "exposure_time_s": frame.exposure.time_s,
        "iso": frame.exposure.iso,
        "f_number": frame.exposure.f_number,
    }


def versions() -> dict[str, str]:
    """Versions of the product and of what its results depend on."""
    return {name: version(name) for name in ("lightlayers", *_LIBRARIES)}


def write_manifest(directory: Path, manifest: dict[str, Any]) -> None:
    """Write manifest.json, as UTF-8. Raises ValueError for figures that are none, OSError."""
    text = json.dumps(manifest, indent=2, ensure_ascii=False, allow_nan=False)
    (directory / MANIFEST).write_text(text + "\n", encoding="utf-8")

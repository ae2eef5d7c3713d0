"""Under which conditions scenes are photographed and sent."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pipeline.encode.exr import write_exr
from pipeline.frames import Image
from tests.evaluation.scenes import SIZE, Scene, render_scene
from tests.evaluation.scoring import valid_pixels
from tests.evaluation.shots import Shot
from tests.evaluation.spectra import flash_spectrum, sensitivities


@dataclass(frozen=True)
class Condition:
    """How a scene is photographed and what the photographer says.

    size: (width, height). motion_px: of the hand between the photographs. lights: the number of
    lamps asked for.
    """

    size: tuple[int, int] = SIZE
    motion_px: float = 0.0
    lights: Literal["auto", "given"] = "given"


def make_shot(scene: Scene, condition: Condition) -> Shot:
    rendered = render_scene(scene, condition.size, condition.motion_px)
    files = (_exr(rendered.no_flash_frame), _exr(rendered.flash_frame))
    options: dict[str, Any] = {
        "camera": scene.camera,
        "flash_spectrum": scene.flash,
        "exposure_ratio": 1.0,
    }
    lights: Any = "auto" if condition.lights == "auto" else len(rendered.lamps)
    return Shot(
        files,
        options,
        lights,
        rendered.lamps,
        valid_pixels(rendered.lamps, rendered.flash, 1.0),
        scene.lamp_spectra,
        flash_spectrum(scene.flash),
        sensitivities(scene.camera),
    )


def _exr(image: Image) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.exr"
        write_exr(path, {c: image[..., k] for k, c in enumerate("RGB")})
        return path.read_bytes()

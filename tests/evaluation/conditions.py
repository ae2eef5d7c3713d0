"""Under which conditions a scene is photographed, and what the photographer says of it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from pipeline.arrays import Floats32
from tests.evaluation.capture import Balance, Contrast, Sensor, capture, capture_jpeg
from tests.evaluation.scenes import SIZE, Scene, render_scene
from tests.evaluation.scoring import valid_pixels
from tests.evaluation.shake import shaken
from tests.evaluation.shots import Shot
from tests.evaluation.spectra import (
    CAMERAS,
    axes,
    coefficients,
    flash_spectrum,
    sensitivities,
    table,
)

_SENSOR = Sensor()
_BANDS = 2.5  # to the picture


@dataclass(frozen=True)
class Condition:
    """How a scene is photographed and sent.

    size: (width, height). files: exact linear values, those of a sensor with its noise, or JPEG.
    contrast: that the camera gives a JPEG. balance: the light that a JPEG's white is balanced for.
    mapping: power of its surroundings by which the camera divides the light of a JPEG.
    exposure: share of the light that is let in. motion_px: of the hand between the photographs.
    shake_px: of the hand during the one without the flash.
    walk: of a person between the photographs, in widths of the picture; 0 where there is none.
    lamp_change: by how much brighter the first lamp is in the flash photograph, of itself.
    bands: height of the bands, in the flash photograph, of lamps that flicker, of their light.
    vignetting: by how much the flash photograph's corners are darker than the other's, of itself.
    camera, flash: names to be told, None for the right ones, by its table where the product does
    not know the camera by name; nothing is told with a JPEG, whose
    colours are those of sRGB. camera_told: whether anything is said of the camera. lights: whether
    the number of lamps is told, or a wrong one.
    flash_strength: of all lamps together. exposure_ratio: to be told; the true one is 1.
    """

    size: tuple[int, int] = SIZE
    files: Literal["exact", "noisy", "jpeg"] = "exact"
    contrast: Contrast = "none"
    balance: Balance = "daylight"
    mapping: float = 0.0
    exposure: float = 1.0
    motion_px: float = 0.0
    shake_px: float = 0.0
    walk: float = 0.0
    lamp_change: float = 0.0
    bands: float = 0.0
    vignetting: float = 0.0
    camera: str | None = None
    camera_told: bool = True
    flash: str | None = None
    lights: Literal["told", "auto", 1] = "told"
    flash_strength: float = 1.0
    exposure_ratio: float = 1.0


def make_shot(scene: Scene, condition: Condition) -> Shot:
    """Photograph a scene. Only the first time it is rendered."""
    rendered = render_scene(
        scene, condition.size, condition.motion_px, condition.flash_strength, condition.walk
    )
    if condition.shake_px:
        rendered = shaken(rendered, condition.shake_px)
    if condition.lamp_change:
        more = np.float32(condition.lamp_change) * rendered.lamps[0]
        rendered = replace(rendered, flash_frame=rendered.flash_frame + more)
    if condition.bands:
        height = condition.size[1]
        wave = np.sin(2 * np.pi * _BANDS * (np.arange(height) + 0.5) / height)
        more = (condition.bands * wave[:, None, None] * rendered.lamps.sum(axis=0)).astype(
            np.float32
        )
        rendered = replace(rendered, flash_frame=rendered.flash_frame + more)
    if condition.vignetting:
        less = np.float32(condition.vignetting) * _squared_radius(condition.size)
        rendered = replace(rendered, flash_frame=rendered.flash_frame * (1 - less[..., None]))
    if condition.files == "jpeg":
        taken = capture_jpeg(rendered, condition.contrast, condition.balance, condition.mapping)
    else:
        sensor = _SENSOR if condition.files == "noisy" else None
        taken = capture(rendered, sensor, condition.exposure)
    options: dict[str, Any] = {
        "encoding": taken.encoding,
        "flash_spectrum": condition.flash or scene.flash,
        "exposure_ratio": condition.exposure_ratio,
    }
    if condition.camera_told and condition.files != "jpeg":
        known = scene.camera if scene.camera in CAMERAS else table(scene.camera)
        options["camera"] = condition.camera or known
    seen = coefficients(scene.lamp_spectra, scene.camera)
    shot = Shot(
        files=(taken.no_flash, taken.flash),
        options=options,
        lights=_told(len(scene.lamp_spectra)) if condition.lights == "told" else condition.lights,
        truth=taken.truth,
        flash_part=taken.flash_part,
        valid=valid_pixels(rendered.lamps, rendered.flash, 1.0),
        lamp_spectra=scene.lamp_spectra,
        flash_spectrum=flash_spectrum(scene.flash),
        sensitivities=sensitivities(scene.camera),
        axes=axes(scene.camera),
        coefficients=None if condition.files == "jpeg" else seen,
    )
    return shot if condition.contrast == "none" else _on_its_scale(shot)


def _squared_radius(size: tuple[int, int]) -> Floats32:
    """Squared distance (H, W) from the middle of a picture, 1 in its corners."""
    width, height = size
    y, x = np.mgrid[:height, :width] + 0.5
    squared = (x - width / 2) ** 2 + (y - height / 2) ** 2
    return np.asarray(squared / ((width / 2) ** 2 + (height / 2) ** 2), np.float32)


def _on_its_scale(shot: Shot) -> Shot:
    """The shot with its truth as bright as the photograph, by one scale for all light.

    How bright light is that a contrast has hidden is told by no file.
    """
    light, truth = shot.photograph[shot.valid], shot.truth.sum(axis=0)[shot.valid]
    scale = np.float32((light * truth).sum() / np.square(truth).sum())
    return replace(shot, truth=scale * shot.truth, flash_part=scale * shot.flash_part)


def _told(count: int) -> Literal[1, 2, 3]:
    if count == 1:
        return 1
    if count == 2:
        return 2
    if count == 3:
        return 3
    raise ValueError(f"{count} lamps cannot be asked for")

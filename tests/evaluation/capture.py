"""The two files that a photographer would send of a rendered scene."""

from __future__ import annotations

import hashlib
import io
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
import tifffile
from PIL import Image as PillowImage
from scipy.interpolate import PchipInterpolator

from pipeline.arrays import Floats, Floats32, Floats64
from pipeline.colour.curves import linear_to_srgb
from pipeline.colour.spaces import XYZ_TO_SRGB
from pipeline.images.frames import Image
from pipeline.spectra.colorimetry import camera_to_xyz
from pipeline.spectra.lights import find_light
from tests.evaluation.scenes import WHITE_LEVEL, RenderedScene
from tests.evaluation.spectra import reflectances, sensitivities

JPEG_QUALITY = 92

Contrast = Literal["none", "s-curve", "strong"]
"""That a camera puts on top of sRGB's curve: code values moved by .05·sin 2π away from the middle;
or middle tones twice as bright and highlights flat, as many cameras have it by default."""

Balance = Literal["daylight", "bulbs"]
"""What light a JPEG's white is balanced for: D65, or illuminant A, that of tungsten bulbs."""

_BALANCED_FOR: dict[Balance, str] = {"daylight": "D65", "bulbs": "A"}

_SURROUNDINGS, _EDGE = 0.06, 0.5  # of the width; natural logarithm
_MIDDLE, _DARK = 0.2, 1e-3  # of white
_STRONG = PchipInterpolator(
    (0.0, 0.028, 0.121, 0.46, 0.859, 1.0), (0.0, 0.03, 0.232, 0.748, 0.968, 1.0)
)
"""Light that is shown, over light."""


@dataclass(frozen=True)
class Sensor:
    """A sensor and its converter. full_well, read_noise: electrons; bits: of the converter."""

    full_well: float = 20_000.0
    read_noise: float = 5.0
    bits: int = 14


@dataclass(frozen=True)
class Capture:
    """A pair of files. truth: float32 (N, H, W, 3), the layers in the values of the files.

    flash_part: (H, W, 3), the flash's light alone in the same values, without noise and motion.
    encoding: to be passed on as the option of that name.
    """

    no_flash: bytes
    flash: bytes
    truth: Floats32
    flash_part: Image
    encoding: str


def capture(
    rendered: RenderedScene, sensor: Sensor | None = None, exposure: float = 1.0
) -> Capture:
    """Take linear pictures in the camera's own colours.

    sensor: None for float files of the exact values, else 16-bit files of the noisy ones.
    exposure: share of the light let in; the files and the truth are darker by it.
    Noise is drawn anew for each photograph and is the same in each run.
    """
    frames = [rendered.no_flash_frame * exposure, rendered.flash_frame * exposure]
    if sensor is not None:
        randoms = (_random(f"{rendered.scene.name} {which} {exposure:g}") for which in range(2))
        frames = [
            expose(frame, sensor, random).astype(np.float32)
            for frame, random in zip(frames, randoms, strict=True)
        ]
    no_flash, flash = (tiff(frame, exact=sensor is None) for frame in frames)
    truth, flash_part = (np.float32(exposure) * light for light in (rendered.lamps, rendered.flash))
    return Capture(no_flash, flash, truth, flash_part, "linear")


def capture_jpeg(
    rendered: RenderedScene,
    contrast: Contrast = "none",
    balance: Balance = "daylight",
    mapping: float = 0.0,
) -> Capture:
    """Have the camera make JPEGs: its colours brought to sRGB for a light, then sRGB's curve.

    contrast: of its own; the truth is light without it. balance: for what light, by gains of the
    camera's channels. mapping: power of its surroundings by which light is divided, in either
    photograph by itself; the truth is mapped as the photograph without the flash. No noise
    reduction; exposed as scenes are, for the brightest channel of sRGB. What sRGB cannot hold is
    cut off.
    """
    scene = rendered.scene
    sensor, daylight = sensitivities(scene.camera), find_light("D65")
    to_xyz = camera_to_xyz(sensor, daylight, reflectances(scene.split))
    gains = (sensor @ daylight) / (sensor @ find_light(_BALANCED_FOR[balance]))
    matrix = (XYZ_TO_SRGB @ to_xyz * (gains / gains[1])).astype(np.float32)
    frames = [frame @ matrix.T for frame in (rendered.no_flash_frame, rendered.flash_frame)]
    factors = [_mapping(frame, mapping) for frame in frames]
    frames = [frame * factor for frame, factor in zip(frames, factors, strict=True)]
    scale = WHITE_LEVEL / np.percentile(frames[1].max(axis=2), 99.9).astype(np.float32)
    no_flash, flash = (_jpeg(scale * frame, contrast) for frame in frames)
    lamps, flash_part = (
        scale * factors[0] * (light @ matrix.T) for light in (rendered.lamps, rendered.flash)
    )
    return Capture(no_flash, flash, lamps, flash_part, "auto")


def _mapping(light: Image, power: float) -> Floats32:
    """What local tone mapping multiplies light (H, W, 3) by, (H, W, 1).

    Source: Durand & Dorsey, "Fast Bilateral Filtering for the Display of High-Dynamic-Range
    Images", 2002: the base layer of the logarithm is compressed.
    """
    if not power:
        return np.ones((*light.shape[:2], 1), np.float32)
    grey = cv2.cvtColor(np.asarray(light, np.float32), cv2.COLOR_RGB2GRAY)
    around = _SURROUNDINGS * grey.shape[1]
    base = cv2.bilateralFilter(np.log(np.maximum(grey, _DARK)), -1, _EDGE, around)
    return np.asarray(np.exp(power * (np.log(_MIDDLE) - base))[..., None], np.float32)


def expose(light: Image, sensor: Sensor, random: np.random.Generator) -> Floats64:
    """What a sensor makes of light: photons and read noise in electrons, then codes from 0 to 1."""
    electrons = random.poisson(np.clip(light, 0, None) * sensor.full_well).astype(np.float64)
    electrons += sensor.read_noise * random.standard_normal(light.shape)
    steps = 2**sensor.bits - 1
    return np.asarray(np.clip(np.round(electrons / sensor.full_well * steps), 0, steps) / steps)


def tiff(values: Floats, exact: bool) -> bytes:
    """A linear TIFF, of float if exact, else of 16 bits."""
    data = (
        values.astype(np.float32)
        if exact
        else np.round(np.clip(values, 0, 1) * 65535).astype(np.uint16)
    )
    file = io.BytesIO()
    tifffile.imwrite(file, data, photometric="rgb", metadata=None)
    return file.getvalue()


def _random(seed: str) -> np.random.Generator:
    return np.random.default_rng(int.from_bytes(hashlib.sha256(seed.encode()).digest()[:8]))


def _jpeg(linear: Image, contrast: Contrast) -> bytes:
    light = np.clip(linear, 0, 1)
    codes = linear_to_srgb(_STRONG(light) if contrast == "strong" else light)
    if contrast == "s-curve":
        codes = codes - 0.05 * np.sin(2 * np.pi * codes)
    codes = np.round(255 * codes).astype(np.uint8)
    file = io.BytesIO()
    PillowImage.fromarray(codes).save(file, "JPEG", quality=JPEG_QUALITY, subsampling="4:4:4")
    return file.getvalue()

"""The simulated studio: a scene under its lamps, as light on the camera's sensor."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import numpy as np
from numpy.typing import NDArray

from drivers.sim import spectra
from drivers.sim.address import SimulatedCamera, parse
from drivers.sim.render import Image, Renderer
from drivers.sim.scene import Scene, load_scene
from drivers.truth import SimulatedTruth

Array = NDArray[np.float64]

_ROWS = 64  # rendered at once
_METER_WIDTH = 150  # pixels of the rendering that exposure is metered on
_GREY_CARD = 0.18  # reflectance


class Studio:
    """A scene with its lamps set up and its exposure metered."""

    def __init__(self, options: SimulatedCamera) -> None:
        self.options = options
        self.scene: Scene = load_scene(options.scene)
        self._renderer = Renderer(self.scene, options.lights, options.width, options.height)
        self._set_up_lights()

    def _set_up_lights(self) -> None:
        options, s = self.options, spectra.sensitivities()
        rho, green, colours = _responses(self.scene, options.lights)
        height = max(2, round(_METER_WIDTH * options.height / options.width))
        gain = self.scene.highlight / _brightest(options.scene, options.lights, height)
        self._colours = colours * gain
        self._white = green @ s.T * gain
        neutral = _scaled(spectra.daylight(), 1.0)
        strengths = self._white[:-1, 1]
        self._neutral_colours = np.zeros_like(colours)  # the flash is not part of that picture
        self._neutral_colours[:, :-1] = np.einsum("mw,j,kw->mjk", rho * neutral, strengths, s)

    def _blocks(self, colours: Array) -> Iterator[tuple[slice, Image, Image]]:
        """(rows, light of each source (sources, h, W, 3), normals (h, W, 3)), top to bottom."""
        for top in range(0, self.options.height, _ROWS):
            rows = slice(top, min(top + _ROWS, self.options.height))
            yield rows, *self._renderer.block(rows, colours)

    def sensor_light(self) -> tuple[Image, Image]:
        """Render what falls on the sensor behind its RGGB mosaic: (lamps, flash), each (H, W)."""
        size = (self.options.height, self.options.width)
        lamps, flash = np.empty(size, np.float32), np.empty(size, np.float32)
        for rows, light, _ in self._blocks(self._colours):
            lamps[rows], flash[rows] = mosaic(light[:-1].sum(0)), mosaic(light[-1])
        return lamps, flash

    def truth(self) -> SimulatedTruth:
        """Everything that is known of the scene."""
        count = self.options.lights
        size = (self.options.height, self.options.width, 3)
        layers = np.empty((count, *size), np.float32)
        flash, balanced, normals = (np.empty(size, np.float32) for _ in range(3))
        both = np.concatenate([self._colours, self._neutral_colours], axis=2)
        for rows, light, facing in self._blocks(both):
            layers[:, rows], flash[rows] = light[:-1, ..., :3], light[-1, ..., :3]
            balanced[rows], normals[rows] = light[..., 3:].sum(0), facing
        eye = self._renderer.eye
        return SimulatedTruth(
            layers=layers,
            flash=flash,
            white_balanced=balanced,
            normals=normals,
            directions=self._renderer.to_lamps @ eye.rotation.T,
            strengths=self._white[:-1, 1],
            rgb=self._white[:-1] * _GREY_CARD,
            lamps=tuple(lamp.name for lamp in self.scene.lamps[:count]),
            camera=f"{spectra.MAKE} {spectra.MODEL}",
            focal_px=eye.focal_px,
        )


def truth(address: str) -> SimulatedTruth:
    """Tell the exact light at an address. Raises BadAddressError, CameraNotFoundError."""
    return Studio(parse(address)).truth()


def mosaic(image: Image) -> Image:
    """Keep the channel that each photosite of an RGGB mosaic sees, (H, W), from an even row on."""
    seen = image[..., 1].copy()
    seen[::2, ::2] = image[::2, ::2, 0]
    seen[1::2, 1::2] = image[1::2, 1::2, 2]
    return seen


@cache
def _brightest(scene: str, lights: int, height: int) -> float:
    """Find the brightest value of a scene's flash photograph, on a small rendering."""
    loaded = load_scene(scene)
    small = Renderer(loaded, lights, _METER_WIDTH, height)
    light, _ = small.block(slice(0, height), _responses(loaded, lights)[2])
    return float(light.sum(0).max())


def _responses(scene: Scene, lights: int) -> tuple[Array, Array, Array]:
    """What the camera answers to a scene, before its exposure is metered.

    (materials, W) reflectances; (sources, W) spectra of the lamps, and last of the flash;
    (materials, sources, 3) responses to each material under each of them.
    """
    lamps = scene.lamps[:lights]
    spds = [*(_spectrum(lamp.light, lamp.through) for lamp in lamps), spectra.flash()]
    power = [*(lamp.strength for lamp in lamps), scene.flash]
    green = np.stack([_scaled(spd, level) for spd, level in zip(spds, power, strict=True)])
    rho = np.stack([spectra.reflectance(name) for name in scene.materials.values()])
    return rho, green, np.einsum("mw,jw,kw->mjk", rho, green, spectra.sensitivities())


def _spectrum(light: str, through: str | None) -> Array:
    spd = spectra.light(light)
    return spd if through is None else spd * spectra.reflectance(through)


def _scaled(spd: Array, level: float) -> Array:
    """Scale a spectrum so that a white card's green response is the level."""
    return np.asarray(spd * (level / (spectra.sensitivities()[1] @ spd)))

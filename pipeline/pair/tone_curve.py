"""The contrast that a camera put on top of sRGB's curve, and light without it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pipeline.arrays import Floats, Floats32, Floats64
from pipeline.colour.curves import linear_to_srgb, srgb_to_linear
from pipeline.compiling import exact
from pipeline.images.coded_image import TableImage
from pipeline.images.frames import Frame, Photograph
from pipeline.images.memory import empty_image
from pipeline.images.noise import Noise, line_through
from pipeline.images.strips import strips

KNOTS: Floats64 = np.linspace(0.0, 1.0, 11)
"""Code values of sRGB at which a curve is known; between them its logarithm is a line."""

_ROWS = 64
_GAINS = 1025  # evenly over roots of light, about which code values are even
_NOISE_CODES = np.linspace(0.1, 0.95, 18)  # at which noise is brought through the curve
_STEP = 0.01  # relative, for the slope of the curve


@dataclass(frozen=True)
class ToneCurve:
    """How much light a camera's code values mean.

    logs: (11,), at the code values KNOTS the natural logarithm of light over what the curve of
    sRGB says, 0 at white.
    """

    logs: Floats64

    @property
    def rises(self) -> bool:
        """Whether light grows at least in proportion to code values from .1 on.

        So it does through cameras' curves, if not in the deepest shadows; about with the square.
        """
        light = np.log(srgb_to_linear(KNOTS[1:])) + self.logs[1:]
        return bool((np.diff(light) >= np.diff(np.log(KNOTS[1:]))).all())

    def light(self, srgb: Floats) -> Floats32:
        """Light of values that sRGB's curve has made linear (1.0 = white), of any shape.

        Beyond 0 and white it goes on in proportion.
        """
        codes = linear_to_srgb(np.clip(srgb, 0.0, 1.0))
        return np.asarray(srgb * np.exp(np.interp(codes, KNOTS, self.logs)), np.float32)

    def entry(self) -> dict[str, Any]:
        """Code values, 0…1, and the light that they mean, 0…1, for the manifest."""
        light = self.light(srgb_to_linear(KNOTS))
        return {"codes": [*KNOTS.round(1)], "light": [round(float(one), 5) for one in light]}

    def photograph(self, photograph: Photograph, own: bool = False) -> Photograph:
        """Light of a photograph (H, W, 3). own: whether it may be overwritten."""
        if isinstance(photograph, TableImage):
            return photograph.mapped(self.light)
        if own and isinstance(photograph, np.ndarray):
            light = photograph
        else:
            light = empty_image(*photograph.shape)
        roots = np.linspace(0.0, 1.0, _GAINS)
        codes = linear_to_srgb(np.square(roots))
        gains = np.exp(np.interp(codes, KNOTS, self.logs)).astype(np.float32)
        for rows in strips(len(photograph), _ROWS):
            _multiply(np.ascontiguousarray(photograph[rows]), gains, light[rows])
        return light

    def frame(self, frame: Frame) -> Frame:
        """The frame in light, with the noise that its compression makes of that."""
        compression = frame.compression and self.noise(frame.compression)
        return replace(frame, pixels=self.photograph(frame.pixels), compression=compression)

    def noise(self, noise: Noise) -> Noise:
        """The line through what noise of linear sRGB becomes by the slope of the curve."""
        values = np.repeat(srgb_to_linear(_NOISE_CODES)[:, None], 3, axis=1)
        above, below = (self.light(values * (1 + sign * _STEP)) for sign in (1, -1))
        slopes = (above - below) / (2 * _STEP * values)
        variances = noise.variance(values) * np.square(slopes)
        light = self.light(values)
        lines = [line_through(light[:, k], variances[:, k]) for k in range(3)]
        gain, floor = np.array(lines).T
        return Noise(gain, floor, noise.grain)


NO_CONTRAST = ToneCurve(np.zeros(len(KNOTS)))
"""sRGB's curve alone."""


@exact
def _multiply(values: Floats32, gains: Floats32, out: Floats32) -> None:
    """Values (h, W, 3) by what gains (m,) are at their roots, from 0 to 1; between two a line."""
    zero, one, last = np.float32(0.0), np.float32(1.0), len(gains) - 1
    for y in range(values.shape[0]):
        for x in range(values.shape[1]):
            for k in range(3):
                value = values[y, x, k]
                place = np.sqrt(min(max(value, zero), one)) * np.float32(last)
                below = min(int(place), last - 1)
                share = place - np.float32(below)
                out[y, x, k] = value * (gains[below] + share * (gains[below + 1] - gains[below]))

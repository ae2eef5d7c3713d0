"""Highlights: light that a glossy surface mirrors, dealt out to what is mirrored.

In the proportions of matt lamps alone a highlight, which does not have the surface's colour, is
dealt out to the wrong ones.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Floats32, Floats64
from pipeline.compiling import compiled
from pipeline.images.enlarge import enlarge
from pipeline.images.frames import Image, Planes, channels_first, planes_of
from pipeline.lamps.lamps import Lamps
from pipeline.separation.mirrored_light import (
    KINDS,
    TwoLamps,
    explain,
    light_of_two,
    matt_light,
    mirrored_light,
)
from pipeline.separation.proportions import pixel


@dataclass(frozen=True)
class Highlights:
    """Highlights of two lamps and of the flash.

    blocks: (h, w, 5) of a reduced pair: 0 or 1, whether the first lamp is mirrored, the second,
    the flash; shares of both lamps in the matt light there. side: of a block in pixels. colours:
    (2, 3) camera RGB of what mirrors the light of either lamp.
    """

    blocks: Floats32
    side: int
    colours: Floats64

    def deal_out(
        self, rows: slice, no_flash: Image, flash: Image, lamps: Lamps, proportions: Floats32
    ) -> Floats32:
        """Return proportions (2, h, W, 3) of some rows, changed where there are highlights.

        no_flash, flash: (h, W, 3) of these rows, flash the flash part alone, noise filtered.
        proportions: of matt light alone; those that lie in memory by planes are changed in place.
        """
        near = self.blocks[max(rows.start // self.side - 1, 0) : rows.stop // self.side + 2]
        if not near[..., :KINDS].any():
            return proportions
        planes = np.empty((self.blocks.shape[2], *no_flash.shape[:2]), np.float32)
        enlarge(self.blocks, self.side, rows, planes)
        light, parts = light_of_two(lamps, self.colours), channels_first(proportions)
        own, rest = ((one[0], one[1], one[2]) for one in parts)
        _deal_out(planes_of(no_flash), planes_of(flash), light, planes, own, rest)
        return np.moveaxis(parts, -3, -1)


@compiled
def _deal_out(
    no_flash: Planes,
    flash: Planes,
    lamps: TwoLamps,
    highlights: Floats32,
    own: Planes,
    rest: Planes,
) -> None:
    """Blend proportions of matt and mirrored light into those of matt light alone."""
    one, zero = np.float32(1.0), np.float32(0.0)
    for y in range(highlights.shape[1]):
        for x in range(highlights.shape[2]):
            s0, s1 = highlights[KINDS, y, x], highlights[KINDS + 1, y, x]
            matt = pixel(own, y, x)
            for kind in range(KINDS):
                weight = highlights[kind, y, x]
                if not weight > 0:
                    continue
                first, second = matt_light(lamps, pixel(flash, y, x), s0, s1)
                mirrored = mirrored_light(lamps.colours, kind, s0, s1)
                a, b = explain(pixel(no_flash, y, x), first, second, mirrored, lamps.weights)
                for k in range(3):
                    light, other = a * first[k], a * second[k]
                    if kind == 0:
                        light += b * np.float32(lamps.colours[0][k])
                    elif kind == 1:
                        other += b * np.float32(lamps.colours[1][k])
                    else:
                        light -= b * s0 * np.float32(lamps.colours[0][k])
                        other -= b * s1 * np.float32(lamps.colours[1][k])
                    # by a matrix a coloured lamp may give a white card less than nothing
                    light, other = max(light, zero), max(other, zero)
                    total = light + other
                    change = light / total - matt[k] if total > 0 else zero
                    own[k][y, x] += weight * change
                    rest[k][y, x] = one - own[k][y, x]

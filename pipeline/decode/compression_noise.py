"""What compression has changed in a photograph, by what it changes when it is done again.

Source: Nosratinia 2001, who compresses a JPEG again with its blocks elsewhere to take the blocks
away. What that changes is as much, and lies where, the first compression changed.
"""

from __future__ import annotations

import numpy as np

from pipeline.images.area_means import area_means
from pipeline.images.frames import Image
from pipeline.images.noise import GRAIN_SCALES, Noise, line_through

BLOCK = 8
"""Side in pixels of the blocks that JPEG compresses."""

_BINS = 12  # of brightness, through whose points the line is laid
_CLIPPED = 0.99  # code 254; of what is white all over nothing changes
_UNEVEN = 1.5  # edges and texture, which lamps are read off, change more than the mean


def compression_noise(before: Image, after: Image, repeated: tuple[float, float, float]) -> Noise:
    """The noise that compression adds, from what doing it again with other blocks changes.

    before, after: (h, w, 3) linear, at least 8 pixels a side, parts of the photograph and the same
    compressed again. repeated: part 0…1 of the first change's variance that the second one has,
    of each channel. Edges and texture change more than flat areas do; the noise that is returned
    is for all of them, half as much again in variance as the mean.
    """
    height, width = (side // BLOCK * BLOCK for side in before.shape[:2])
    light, change = before[:height, :width], (after - before)[:height, :width]
    squares = np.square(change)
    blocks = width // BLOCK, height // BLOCK
    levels, variances = (area_means(image, blocks).reshape(-1, 3) for image in (light, squares))
    darkest = light.reshape(blocks[1], BLOCK, blocks[0], BLOCK, 3).min(axis=(1, 3)).reshape(-1, 3)
    lines = []
    for channel in range(3):
        order = np.argsort(levels[:, channel], kind="stable")
        known = order[darkest[order, channel] < _CLIPPED]
        of_bins = np.array_split(known if len(known) >= _BINS else order, _BINS)
        bins = [one for one in of_bins if len(one)]
        x, y = ([of[one, channel].mean() for one in bins] for of in (levels, variances))
        lines.append(line_through(np.array(x), np.array(y)))
    gain, floor = np.array(lines).T
    single = max(float(squares.mean()), 1e-30)
    grains = []
    for side in GRAIN_SCALES:
        means = area_means(change, (width // side, height // side))
        grains.append(side**2 * float(np.square(means).mean()) / single)
    scale = _UNEVEN / np.array(repeated)
    return Noise(scale * gain, scale * floor, max(1.0, *grains))

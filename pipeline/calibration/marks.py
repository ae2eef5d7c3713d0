"""What all kinds of marks have in common: pixels that one is around, a picture to find one in."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats
from pipeline.errors import OptionError
from pipeline.images.frames import Mask
from pipeline.options import Circle


def disc(shape: tuple[int, ...], circle: Circle, what: str) -> Mask:
    """Pixels (H, W) within a circle. Raises OptionError where it is not wholly in the picture."""
    height, width = shape[:2]
    inside = circle.radius <= circle.x <= width - circle.radius
    if not (inside and circle.radius <= circle.y <= height - circle.radius):
        raise OptionError(
            f"The circle of the {what} is not wholly inside the photograph of {width} × {height} "
            "pixels: check its coordinates."
        )
    x, y, r = circle.x, circle.y, circle.radius
    mask = np.zeros((height, width), bool)
    # of the whole photograph, coordinates would take gigabytes
    left, top = int(x - r), int(y - r)
    around = mask[top : int(y + r) + 1, left : int(x + r) + 1]
    v, u = np.ogrid[: around.shape[0], : around.shape[1]]
    around[...] = np.hypot(u + left + 0.5 - x, v + top + 0.5 - y) <= r
    return mask


def on_screen(light: Floats) -> NDArray[np.uint8]:
    """Show linear light (H, W, 3) so that each channel fills 8 bits; for finding, not for eyes."""
    high = [max(float(np.quantile(light[..., k], 0.98)), 1e-9) for k in range(3)]
    return np.asarray(np.sqrt(np.clip(light / np.array(high), 0, 1)) * 255).astype(np.uint8)

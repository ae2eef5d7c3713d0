"""Normals from one photograph under three coloured lamps, all surfaces being of one colour.

Source: Woodham, "Photometric method for determining surface orientation from multiple images",
Optical Engineering 19, 1980; three lamps at once in three channels after Drew, 1992.
"""

from __future__ import annotations

import numpy as np

from pipeline.arrays import Floats64
from pipeline.images.frames import Image


def single_shot_normals(photograph: Image, colours: Floats64, directions: Floats64) -> Image:
    """Unit normals n ∝ (C L)⁻¹ I of a surface of one colour; its albedo cancels.

    Parameters
    ----------
    photograph : (H, W, 3), linear camera RGB, divided by the surface's colour
    colours : (3, 3), a column for each lamp, its light on a grey card that faces it
    directions : (3, 3), a row for each lamp, unit vectors to it
    """
    scaled = photograph @ np.linalg.inv(colours @ directions).T
    length = np.linalg.norm(scaled, axis=2, keepdims=True)
    return np.asarray(scaled / np.where(length > 0, length, 1.0), dtype=np.float32)

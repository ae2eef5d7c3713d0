"""What is known of a simulated photograph, for the demo and for tests."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class SimulatedTruth:
    """The exact light of a simulated scene, at the camera's settings when switched on.

    Linear camera RGB throughout; 1.0 is the white level of the no-flash photograph, black is 0,
    without noise, before the colour filter mosaic. H×W is the size in the address, N its lamps.

    layers: float32 (N, H, W, 3), the light of each lamp alone; their sum is the no-flash
        photograph.
    flash: float32 (H, W, 3), what the flash adds to the other photograph.
    white_balanced: float32 (H, W, 3), the scene when every lamp shines like D65 and keeps its
        green response on a white card.
    normals: float32 (H, W, 3), unit, x right, y up, z to the viewer; NaN where there is no
        surface.
    directions: float64 (N, 3), unit, from the surface to each lamp, same axes.
    strengths: float64 (N,), green response of a white card that faces the lamp.
    rgb: float64 (N, 3), response of an 18 % grey card that faces the lamp.
    lamps: names of the lamps. camera: its name. focal_px: focal length in pixels.
    """

    layers: NDArray[np.float32]
    flash: NDArray[np.float32]
    white_balanced: NDArray[np.float32]
    normals: NDArray[np.float32]
    directions: NDArray[np.float64]
    strengths: NDArray[np.float64]
    rgb: NDArray[np.float64]
    lamps: tuple[str, ...]
    camera: str
    focal_px: float

"""Whether a surface turns away at its outline, as things do, or is inside out."""

from __future__ import annotations

import cv2
import numpy as np
from scipy import ndimage

from pipeline.arrays import Floats64
from pipeline.images.frames import Mask

_BLUR = 2.0  # pixels, over which the outline's own direction is told
_REACH = 2  # pixels from the outline inwards that count
_LEAST_SLOPE = 0.03  # of the blurred mask; less is the border of the picture
_FEW = 200  # pixels of an outline that tell nothing


def turns_away(mask: Mask, w: Floats64) -> float:
    """How far a surface turns away at its outline, along the axis where it does so least, −1…1.

    At the outline of a round thing normals point outwards (Marr, "Analysis of occluding contour",
    1977). Means over outline pixels of outward direction × normal make a 2 × 2 matrix, whose
    symmetric part has this least eigenvalue: .35 and more of round things, about 0 of faces that
    look at the camera, and below where the surface is inside out, if only along one axis. Gaps
    within a thing and borders of the picture are no outline; without any it is 0.

    mask: (h, w), where the surface is. w: (h, w, 3) normals of any length, x right, y up.
    """
    whole = ndimage.binary_fill_holes(mask)
    blurred = cv2.GaussianBlur(
        whole.astype(np.float64), (0, 0), _BLUR, borderType=cv2.BORDER_REPLICATE
    )
    down, right = np.gradient(-blurred)
    slope = np.hypot(down, right)
    square = np.ones((2 * _REACH + 1, 2 * _REACH + 1), np.uint8)
    within = cv2.erode(whole.astype(np.uint8), square, borderType=cv2.BORDER_REPLICATE) > 0
    at = mask & ~within & (slope > _LEAST_SLOPE)
    if np.count_nonzero(at) < _FEW:
        return 0.0
    outwards = np.stack([right[at], -down[at]], axis=1) / slope[at][:, None]
    normals = w[at][:, :2] / np.linalg.norm(w[at], axis=1, keepdims=True)
    turned = outwards.T @ normals / len(normals)
    return float(np.linalg.eigvalsh((turned + turned.T) / 2)[0])

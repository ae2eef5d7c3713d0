"""How bright a picture is shown."""

from __future__ import annotations

import numpy as np

from pipeline.images.frames import Matrix, Photograph
from pipeline.images.quantiles import quantile

_MOST = 8.0  # three stops; what is darker stays dark
_WHITE = 0.995  # quantile of a picture's brightest channel that becomes white
_SAMPLES = 1000  # pixels looked at along the longer side, or twice as many


def shown_gain(picture: Photograph, matrix: Matrix) -> float:
    """Factor, at most 8, by which bright parts of a picture (H, W, 3) become white.

    matrix: (3, 3), to the linear RGB of the screen.
    """
    step = max(1, max(picture.shape[:2]) // _SAMPLES)
    shown = picture[::step, ::step] @ matrix.T.astype(np.float32)
    # not .max(axis=2), which takes ten times as long for three channels
    brightest = np.maximum(np.maximum(shown[..., 0], shown[..., 1]), shown[..., 2])
    white = quantile(brightest, _WHITE)
    return min(1.0 / max(white, 1e-6), _MOST)

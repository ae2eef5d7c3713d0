"""One light for the whole picture, from its mean colour.

Source: Finlayson and Trezzi, "Shades of Gray and Colour Constancy", CIC 2004; power 1 is the grey
world of Buchsbaum, "A spatial processor model for object colour perception", 1980.
"""

from __future__ import annotations

import numpy as np

from pipeline.arrays import Floats64
from pipeline.images.frames import Image


def shades_of_grey(photograph: Image, neutral: Floats64, power: float) -> Image:
    """Scale the channels so that their Minkowski means have the colour of the neutral light.

    photograph: (H, W, 3) linear camera RGB. neutral: (3,), a white card's under the neutral light.
    power: of the mean. Green stays as it is; a black photograph is black.
    """
    values = np.maximum(photograph.reshape(-1, 3), 0.0).astype(np.float64)
    means = np.mean(values**power, axis=0) ** (1 / power)
    gains = (neutral / neutral[1]) * means[1] / np.where(means > 0, means, 1.0)
    return np.asarray(photograph * gains, dtype=np.float32)

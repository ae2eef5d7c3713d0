from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def srgb_to_linear(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """Undo the sRGB curve of IEC 61966-2-1 (1.0 = white); below 0 it goes on as a line."""
    curve = ((np.maximum(values, 0.0) + 0.055) / 1.055) ** 2.4
    return np.where(values <= 0.04045, values / 12.92, curve).astype(np.float32)

from __future__ import annotations

import numpy as np
import pytest

from pipeline.arrays import Floats32


@pytest.fixture
def picture() -> Floats32:
    """Linear values from below black to above white, higher than one strip."""
    rng = np.random.default_rng(5)
    return np.asarray(rng.uniform(-0.1, 1.3, (300, 20, 3)), dtype=np.float32)

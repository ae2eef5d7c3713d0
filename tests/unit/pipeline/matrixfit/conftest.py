from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from pipeline.arrays import Floats64


@pytest.fixture(scope="session")
def off() -> Callable[[Floats64, Floats64], float]:
    """Largest entry by which a true matrix of unit norm differs from the nearest one found."""

    def of_matrices(found: Floats64, true: Floats64) -> float:
        unit = true / np.linalg.norm(true, axis=(1, 2), keepdims=True)
        return float(np.abs(found[:, None] - unit[None]).max(axis=(2, 3)).min(axis=0).max())

    return of_matrices

"""Colours by a matrix, row by row, within compiled loops over pixels."""

from __future__ import annotations

from typing import Any

import numpy as np

from pipeline.compiling import inlined, spliced
from pipeline.images.frames import Colour, Numbers


@spliced
def by_matrix(m: Numbers, r: Any, g: Any, b: Any) -> Colour:
    """A colour by the matrix m, row by row, in single precision; for exact loops."""
    return (
        np.float32(m[0]) * r + np.float32(m[1]) * g + np.float32(m[2]) * b,
        np.float32(m[3]) * r + np.float32(m[4]) * g + np.float32(m[5]) * b,
        np.float32(m[6]) * r + np.float32(m[7]) * g + np.float32(m[8]) * b,
    )


fused_by_matrix = inlined(by_matrix.py_func)
"""The same with multiplications and additions in one; for other compiled loops."""

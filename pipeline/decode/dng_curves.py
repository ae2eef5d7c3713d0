"""Curves of a lossy DNG in JPEG XL: a polynomial for each colour takes its values back to light.

Adobe's converter stretches the values of each colour before it loses some of them. Source: DNG
specification 1.7.1 (MapPolynomial, BlackLevel, WhiteLevel).
"""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray
from tifffile import TiffPage

from pipeline.arrays import Floats64
from pipeline.decode.dng_levels import BLACK_LEVEL, numbers
from pipeline.decode.dng_values import polynomials
from pipeline.decode.tiff import LINEAR_RAW, WHITE_LEVEL

OPCODE_LIST_2 = 51009
_AREA = struct.Struct(">4I8x3I")
"""Top, left, bottom and right, then rows and columns from one to the next, and the degree."""
_MOST = 65535


def curves(page: TiffPage) -> NDArray[np.uint16] | None:
    """Tables (3, 65536) from the stored 16 bits of a full linear picture to those that are meant.

    Both are between the levels of black and white that the directory tells. None where there are no
    such polynomials, or ones of a part of the picture. Raises struct.error and ValueError for
    damaged ones.
    """
    found = polynomials(page)
    linear = page.photometric == LINEAR_RAW and page.dtype == np.uint16
    if found is None or not linear or OPCODE_LIST_2 not in page.tags:
        return None
    codes = np.arange(_MOST + 1)
    tables = np.empty((len(found), len(codes)), np.uint16)
    levels = (_levels(page, tag, usual) for tag, usual in ((BLACK_LEVEL, 0), (WHITE_LEVEL, _MOST)))
    for table, parameters, black, white in zip(tables, found, *levels, strict=True):
        *area, by_rows, by_columns, degree = _AREA.unpack_from(parameters)
        whole = area == [0, 0, page.imagelength, page.imagewidth]
        if not whole or (by_rows, by_columns) != (1, 1):
            return None
        factors = struct.unpack_from(f">{degree + 1}d", parameters, _AREA.size)
        if not (np.isfinite(factors).all() and black < white):
            raise ValueError("a polynomial of no values")
        share = np.minimum((codes - black) / (white - black), 1.0)
        light = np.polynomial.Polynomial(factors)(share)
        table[:] = np.rint(np.clip(black + light * (white - black), 0, _MOST))
    return tables


def _levels(page: TiffPage, tag: int, usual: int) -> Floats64:
    """Level of each of three colours. Raises ValueError where there are other numbers of them."""
    return np.broadcast_to(numbers(page, tag, usual), 3)

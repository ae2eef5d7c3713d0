from __future__ import annotations

import numpy as np
import pytest

from pipeline.spectra.colorchecker import COLUMNS, ROWS, colorchecker_spectra
from pipeline.spectra.wavelengths import WAVELENGTHS_NM


def test_patches_are_where_they_lie_on_the_chart() -> None:
    patches = colorchecker_spectra()
    assert patches.shape == (ROWS * COLUMNS, len(WAVELENGTHS_NM))
    at_560 = patches[:, np.flatnonzero(WAVELENGTHS_NM == 560)[0]]
    # the last row goes from white to black
    assert at_560[18:] == pytest.approx([0.91, 0.59, 0.36, 0.19, 0.09, 0.03], abs=0.02)
    blue, red = patches[:, WAVELENGTHS_NM < 500].mean(1), patches[:, WAVELENGTHS_NM > 600].mean(1)
    # blue, green, red, yellow, magenta, cyan
    assert ((red > 2 * blue)[12:18] == [False, False, True, True, True, False]).all()


def test_nobody_changes_them() -> None:
    with pytest.raises(ValueError, match="read-only"):
        colorchecker_spectra()[0, 0] = 1

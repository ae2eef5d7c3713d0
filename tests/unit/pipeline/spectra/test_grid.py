from __future__ import annotations

import numpy as np
import pytest

from pipeline.spectra.grid import WAVELENGTHS_NM, on_grid


def test_a_table_on_the_grid_stays_as_it_is() -> None:
    values = np.sin(WAVELENGTHS_NM / 50)
    np.testing.assert_allclose(on_grid(WAVELENGTHS_NM, values, "hold"), values)


def test_coarse_tables_are_interpolated() -> None:
    coarse = np.arange(380, 781, 20)
    np.testing.assert_allclose(on_grid(coarse, coarse * 2.0, "hold"), WAVELENGTHS_NM * 2.0)


def test_outside_is_zero_or_held() -> None:
    held = on_grid([400, 700], [2.0, 3.0], "hold")
    zero = on_grid([400, 700], [2.0, 3.0], "zero")
    assert (held[0], held[-1]) == (2.0, 3.0)
    assert (zero[0], zero[-1]) == (0.0, 0.0)
    np.testing.assert_array_equal(zero[4:65], held[4:65])


@pytest.mark.parametrize("line_nm", [546.0, 546.1, 547.4, 552.5])
def test_a_narrow_line_keeps_its_energy(line_nm: float) -> None:
    fine = np.arange(380, 780.01, 0.1)
    line = np.exp(-(((fine - line_nm) / 0.5) ** 2))

    assert on_grid(fine, line, "hold").sum() * 5 == pytest.approx(line.sum() * 0.1, rel=1e-3)


def test_columns_are_treated_alike() -> None:
    table = np.random.default_rng(0).uniform(0, 1, (401, 3))
    nm = np.arange(380, 781)
    together = on_grid(nm, table, "zero")
    assert together.shape == (81, 3)
    for column in range(3):
        np.testing.assert_array_equal(together[:, column], on_grid(nm, table[:, column], "zero"))

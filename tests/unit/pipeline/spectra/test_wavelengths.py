from __future__ import annotations

import numpy as np
import pytest

from pipeline.spectra.wavelengths import WAVELENGTHS_NM, on_grid


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


def test_a_line_between_the_rows_of_a_coarse_table_keeps_its_energy() -> None:
    """As tables of discharge lamps are: a continuum in wide steps, and rows of their own for lines.

    The line of 41 stands out by 40 in a triangle 1 nm wide.
    """
    nm = np.sort([*range(380, 781, 10), 545.6, 546.1, 546.6])
    power = np.where(nm == 546.1, 41.0, 1.0)

    found = on_grid(nm, power, "hold")

    assert (found - 1.0).sum() * 5 == pytest.approx(40.0 * 1.0 / 2)
    assert found[33] > 4.0  # at 545 nm


def test_columns_are_treated_alike() -> None:
    table = np.random.default_rng(0).uniform(0, 1, (401, 3))
    nm = np.arange(380, 781)
    together = on_grid(nm, table, "zero")
    assert together.shape == (81, 3)
    for column in range(3):
        np.testing.assert_array_equal(together[:, column], on_grid(nm, table[:, column], "zero"))

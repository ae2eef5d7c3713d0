from __future__ import annotations

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.images.coded_image import TableImage
from pipeline.pair.banding import Banding, series

TERMS = np.array([0.2, 0.1, 0.0, -0.05])


@pytest.mark.parametrize(
    ("waves", "expected"),
    [
        (0.0, (1, 0, 1, 0)),
        (0.25, (0, 1, -1, 0)),
        (0.5, (-1, 0, 1, 0)),
        (1.125, (0.5**0.5, 0.5**0.5, 0, 1)),
    ],
)
def test_a_wave_comes_with_its_first_overtone(waves: float, expected: tuple[float, ...]) -> None:
    np.testing.assert_allclose(series(np.array([waves]))[:, 0], expected, atol=1e-12)


@pytest.mark.parametrize(
    ("terms", "height"), [((0.0, -0.3, 0.0, 0.0), 0.3), ((0.2, 0.0, 0.1, 0.0), 0.3)]
)
def test_its_height_is_the_most_of_any_row(terms: tuple[float, ...], height: float) -> None:
    assert Banding(50.0, np.array(terms), by_columns=False).height == pytest.approx(
        height, abs=1e-3
    )


@pytest.fixture
def light() -> Floats64:
    """Taller than one strip."""
    return np.random.default_rng(2).uniform(0.1, 0.4, (70, 50, 3))


@pytest.mark.parametrize("by_columns", [False, True])
def test_what_rows_gave_more_is_taken_off_the_flash_photograph(
    light: Floats64, by_columns: bool
) -> None:
    places = (np.arange(50 if by_columns else 70) + 0.5) / 40.0
    more = TERMS @ series(places)
    more = more[None, :, None] if by_columns else more[:, None, None]
    flash = (light * (1 + more) + 0.3).astype(np.float32)

    lit = Banding(40.0, TERMS, by_columns).off(light.astype(np.float32), flash)

    assert lit.dtype == np.float32
    np.testing.assert_allclose(lit, light + 0.3, atol=1e-6)


def test_photographs_may_be_codes(light: Floats64) -> None:
    table = np.linspace(0, 1, 256, dtype=np.float32)
    no_flash, flash = (
        TableImage((255 * each).astype(np.uint8), table) for each in (light, 2 * light)
    )

    lit = Banding(40.0, TERMS, by_columns=False).off(no_flash, flash)

    more = (TERMS @ series((np.arange(70) + 0.5) / 40.0))[:, None, None]
    np.testing.assert_allclose(lit, flash[:] - more * no_flash[:], atol=1e-6)

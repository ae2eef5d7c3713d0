from __future__ import annotations

import numpy as np
import pytest

from pipeline.images.coded_image import TableImage
from pipeline.pair.vignetting import Vignetting, squared_radius


@pytest.mark.parametrize(("height", "width"), [(3, 5), (4, 6), (1, 1)])
def test_the_corners_of_the_picture_are_one_away(height: int, width: int) -> None:
    """Corners of pixels, whose middles are half a pixel nearer."""
    found = squared_radius(height, width)

    y, x = np.mgrid[:height, :width] + 0.5
    expected = (y - height / 2) ** 2 + (x - width / 2) ** 2
    expected /= (height / 2) ** 2 + (width / 2) ** 2
    np.testing.assert_allclose(found, expected, atol=1e-12)


@pytest.mark.parametrize("corners", [-0.3, 0.4])
def test_it_is_divided_off_the_flash_photograph(corners: float) -> None:
    """Taller than one strip."""
    light = np.random.default_rng(2).uniform(0.1, 0.4, (70, 50, 3))
    more = 1 + corners * squared_radius(70, 50)[..., None]

    without = Vignetting(corners).off((light * more).astype(np.float32))

    assert without.dtype == np.float32
    np.testing.assert_allclose(without, light, rtol=1e-6)


def test_photographs_may_be_codes() -> None:
    codes = np.random.default_rng(3).integers(0, 255, (40, 30, 3)).astype(np.uint8)
    flash = TableImage(codes, np.linspace(0, 1, 256, dtype=np.float32))

    without = Vignetting(-0.2).off(flash)

    more = 1 - 0.2 * squared_radius(40, 30)[..., None]
    np.testing.assert_allclose(without, flash[:] / more, rtol=1e-6)

from __future__ import annotations

import numpy as np
import pytest

from pipeline.images.disc import disc


@pytest.mark.parametrize("radius", [0, 1, 3, 10])
def test_a_disc_is_as_wide_as_high_and_reaches_its_radius(radius: int) -> None:
    found = disc(radius)

    assert found.shape == (2 * radius + 1, 2 * radius + 1)
    assert found.dtype == np.uint8
    assert found[radius].all()
    assert found[:, radius].all()
    y, x = np.mgrid[-radius : radius + 1, -radius : radius + 1]
    assert not found[np.hypot(x, y) > radius + 1].any()
    assert found[np.hypot(x, y) < radius - 1].all()

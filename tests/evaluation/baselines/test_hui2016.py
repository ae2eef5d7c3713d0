from __future__ import annotations

import numpy as np
import pytest

from tests.evaluation.baselines.hui2016 import pixel_kernels

FLASH_WHITE, NEUTRAL = np.array([0.7, 1.0, 0.9]), np.array([0.6, 1.0, 0.8])


def test_lights_that_scale_channels_are_taken_out_of_every_pixel() -> None:
    """By channels alone the model is exact: what is left is the surface under the neutral light."""
    random = np.random.default_rng(1)
    surface = random.uniform(0.1, 0.9, (6, 8, 3))
    light = random.uniform(0.2, 1.0, (6, 8, 3))  # of another colour in every pixel
    flash = 0.3 * surface * FLASH_WHITE

    found = pixel_kernels((surface * light).astype(np.float32), flash, FLASH_WHITE, NEUTRAL)

    strength = light.sum(axis=2, keepdims=True) / NEUTRAL.sum()
    np.testing.assert_allclose(found, strength * surface * NEUTRAL, rtol=1e-5)


@pytest.mark.parametrize("dark", [0.0, -0.1])
def test_where_the_flash_does_not_reach_nothing_is_known(dark: float) -> None:
    photograph, flash = np.full((2, 2, 3), 0.5, np.float32), np.full((2, 2, 3), 0.5, np.float32)
    flash[0, 0, 1] = dark

    found = pixel_kernels(photograph, flash, FLASH_WHITE, NEUTRAL)

    assert not found[0, 0].any()
    assert (found[1] > 0).all()

from __future__ import annotations

import numpy as np
import pytest

from tests.evaluation.scenes import render_scene, scenes
from tests.evaluation.shake import path, shaken


@pytest.mark.parametrize(
    ("direction", "along"), [(0.0, (1.0, 0.0)), (np.pi / 2, (0.0, 1.0)), (np.pi / 4, (0.5, 0.5))]
)
def test_a_path_has_the_variance_of_its_line_in_its_direction(
    direction: float, along: tuple[float, float]
) -> None:
    kernel = path(6.0, direction)

    reach = len(kernel) // 2
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    variances = [(kernel * axis**2).sum() for axis in (x, y)]
    assert kernel.sum() == pytest.approx(1)
    assert kernel.min() >= 0
    # and up to a quarter of a pixel from laying places between pixels
    np.testing.assert_allclose(variances, [6**2 / 12 * part for part in along], atol=0.3)
    assert (kernel * x).sum() == pytest.approx(0, abs=1e-9)


def test_a_shaken_scene_keeps_its_light_and_its_flash_photograph() -> None:
    still = render_scene(scenes("two", "development")[0], (64, 48))

    found = shaken(still, 4.0)

    np.testing.assert_array_equal(found.flash_frame, still.flash_frame)
    np.testing.assert_allclose(found.lamps.mean(), still.lamps.mean(), rtol=0.02)
    rough = [np.abs(np.diff(one.lamps, axis=2)).mean() for one in (found, still)]
    assert rough[0] < 0.9 * rough[1]
    np.testing.assert_array_equal(found.lamps, shaken(still, 4.0).lamps)

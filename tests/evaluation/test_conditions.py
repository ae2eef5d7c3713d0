from __future__ import annotations

import numpy as np

from pipeline.decode import decode
from tests.evaluation.conditions import Condition, make_shot
from tests.evaluation.scenes import render_scene, scenes


def test_a_lamp_that_changes_is_brighter_in_the_flash_photograph_alone() -> None:
    scene = scenes("two", "development")[0]
    rendered = render_scene(scene, (64, 48))

    shot = make_shot(scene, Condition(size=(64, 48), lamp_change=0.2))

    before, after = (decode(file, "linear").pixels[:] for file in shot.files)
    np.testing.assert_array_equal(before, rendered.no_flash_frame)
    np.testing.assert_allclose(
        after - rendered.flash_frame, 0.2 * rendered.lamps[0], rtol=1e-3, atol=1e-6
    )
    np.testing.assert_array_equal(shot.truth, rendered.lamps)

from __future__ import annotations

import numpy as np

from pipeline.decode import decode
from pipeline.images.frames import Image
from tests.evaluation.conditions import Condition, make_shot
from tests.evaluation.scenes import render_scene, scenes
from tests.evaluation.shots import Shot


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


def test_the_flash_photograph_alone_is_darker_in_its_corners() -> None:
    scene = scenes("two", "development")[0]
    rendered = render_scene(scene, (64, 48))

    shot = make_shot(scene, Condition(size=(64, 48), vignetting=0.3))

    before, after = (decode(file, "linear").pixels[:] for file in shot.files)
    np.testing.assert_array_equal(before, rendered.no_flash_frame)
    factor = after / rendered.flash_frame
    np.testing.assert_allclose(factor[0, 0], 0.7, atol=0.02)
    np.testing.assert_allclose(factor[24, 32], 1.0, atol=1e-3)
    np.testing.assert_allclose(factor[0, 32], 1 - 0.3 * 24**2 / (24**2 + 32**2), atol=5e-3)
    np.testing.assert_array_equal(shot.truth, rendered.lamps)


def test_a_person_walks_on_between_the_photographs() -> None:
    scene = scenes("two", "development")[0]
    size = 64, 48
    alone, walked, far = (
        make_shot(scene, Condition(size=size, walk=walk)) for walk in (0.0, 0.05, 0.4)
    )

    def photographs(shot: Shot) -> list[Image]:
        return [decode(file, "linear").pixels[:] for file in shot.files]

    before, after = photographs(walked)
    np.testing.assert_array_equal(before, walked.truth.sum(axis=0))
    np.testing.assert_array_equal(before, photographs(far)[0])  # who stands there first, is there
    assert np.abs(before - photographs(alone)[0]).max() > 0.05
    still = before + walked.flash_part
    moved = np.abs(after - still).max(axis=2) > 0.02
    assert 0.02 < moved.mean() < 0.5
    assert not moved[:, -8:].any()
    assert np.abs(photographs(far)[1] - still).max(axis=2)[:, 36:52].max() > 0.05

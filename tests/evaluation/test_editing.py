from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from tests.evaluation.editing import (
    METHODS,
    PAIRS,
    Figures,
    by_pair,
    measure,
    pairs,
    scenes_of,
    summary,
)
from tests.evaluation.scenes import render_response, render_scene, scenes

SMALL = (128, 96)
NIKON, SIGMA = "Nikon D5100", "Sigma SD1 Merrill"


@cache
def found() -> dict[str, Figures]:
    return {
        one.method: one for one in measure(scenes("two", "development")[2], NIKON, SIGMA, SMALL)
    }


def test_the_same_camera_sees_the_scene_as_it_is() -> None:
    scene = scenes("two", "development")[2]

    seen = render_response(scene, scene.camera, SMALL)

    np.testing.assert_allclose(seen, render_scene(scene, SMALL).lamps, rtol=1e-4, atol=1e-6)


def test_another_camera_sees_other_colours_as_bright() -> None:
    scene = scenes("two", "development")[2]

    seen, plain = render_response(scene, SIGMA, SMALL), render_scene(scene, SMALL).lamps

    ratio = seen.mean(axis=(1, 2)) / plain.mean(axis=(1, 2))
    np.testing.assert_allclose(ratio[:, 1], 1, atol=0.2)
    assert np.abs(ratio[:, 2] - 1).min() > 0.2


def test_ours_shows_the_colours_of_the_other_camera() -> None:
    figures = found()

    assert tuple(figures) == METHODS
    best = figures["best"]
    assert best.photograph_deg < 1
    assert best.layers_deg < 1.5
    assert best.photograph_deg < figures["paper"].photograph_deg
    assert figures["unchanged"].photograph_deg > 10
    assert figures["known lamps"].photograph_deg < best.photograph_deg
    assert best.delta_e < 0.5 * figures["unchanged"].delta_e


def test_halves_share_no_scene_and_no_camera_but_those_packaged() -> None:
    development, report = ({name for pair in PAIRS[half] for name in pair} for half in PAIRS)

    assert development & report == {NIKON, SIGMA}
    assert all(len(PAIRS[half]) >= 8 for half in PAIRS)
    names = [[s.name for n in range(8) for s in scenes_of(n, half)] for half in PAIRS]
    assert all(len(set(half)) == 24 for half in names)
    assert not set(names[0]) & set(names[1])


def test_without_a_folder_the_packaged_cameras_are_measured(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("LIGHTLAYERS_SPECTRA", raising=False)

    assert pairs("report") == ((NIKON, SIGMA), (SIGMA, NIKON))


def test_tables_hold_means_and_worst_values() -> None:
    figures = [
        Figures(NIKON, shown, "scene", method, degrees, 2 * degrees, 3 * degrees)
        for method in METHODS
        for shown, degrees in ((SIGMA, 1.0), (NIKON, 3.0))
    ]

    assert summary(figures)[1] == ["best", "2.00 / 3.00", "4.00 / 6.00", "6.00 / 9.00"]
    assert by_pair(figures)[1] == [NIKON, SIGMA, *["1.00 / 2.00"] * len(METHODS)]
    assert by_pair(figures)[2] == [NIKON, NIKON, *["3.00 / 6.00"] * len(METHODS)]

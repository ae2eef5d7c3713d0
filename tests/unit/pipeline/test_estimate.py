from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Literal

import numpy as np
import pytest

from pipeline import estimate as estimate_module
from pipeline.arrays import Floats64
from pipeline.errors import OptionError
from pipeline.estimate import Estimate, make_estimate
from pipeline.images.frames import Frame, Mask
from pipeline.lamps.lamps import Lamps, estimate_lamps
from pipeline.light.model import Model, build_model
from pipeline.options import DirectedLight, Options
from pipeline.pair.moved_shadows import MovedShadows
from pipeline.pair.pair import Pair
from pipeline.pair.reduced import ReducedPair, reduce_pair
from pipeline.progress import Progress
from pipeline.run_warnings import Code, RunWarning
from pipeline.spectra.cameras import Camera, srgb_stand_in
from pipeline.spectra.lights import find_light

DIRECTIONS = ((-0.6, 0.35, 0.7), (0.65, 0.3, 0.7), (0.05, -0.55, 0.8))


@pytest.fixture
def estimated(
    exact: Callable[..., tuple[Any, Floats64]],
    frame: Callable[..., Frame],
    model: Model,
    warm_to_cool: Floats64,
) -> Callable[..., Estimate]:
    """Estimate what a pair of two lamps, or so many, tells."""

    def run(*wanted: str, count: Literal[2, 3] = 2, by: Model = model, **options: Any) -> Estimate:
        pair, _ = exact(warm_to_cool[[0, 2]] if count == 2 else warm_to_cool)
        photograph = frame(np.zeros((64, 96, 3)))
        chosen = Options(lights=count, **options)
        names = frozenset(wanted)
        reduced = reduce_pair(pair)
        return make_estimate(pair, reduced, by, photograph, chosen, names, Progress())

    return run


@pytest.fixture
def estimate_two(frame: Callable[..., Frame], model: Model) -> Callable[[Pair], Estimate]:
    """Estimate what a pair tells of two lamps."""

    def run(pair: Pair) -> Estimate:
        photograph = frame(np.zeros((64, 96, 3)))
        chosen, reduced = Options(lights=2), reduce_pair(pair)
        return make_estimate(pair, reduced, model, photograph, chosen, frozenset(), Progress())

    return run


def lit(colours: Floats64) -> list[DirectedLight]:
    return [
        DirectedLight(direction=direction, rgb=tuple(colour))
        for direction, colour in zip(DIRECTIONS, colours, strict=True)
    ]


def test_the_lamps_are_found_from_warm_to_cool(
    estimated: Callable[..., Estimate], warm_to_cool: Floats64
) -> None:
    found = estimated()

    cosines = (found.lamps.coefficients * warm_to_cool[[0, 2]]).sum(axis=1)
    assert np.degrees(np.arccos(np.minimum(cosines, 1))) == pytest.approx([0, 0], abs=3.0)
    assert found.facing is None
    assert found.changes is None


def test_another_camera_has_a_matrix_for_each_lamp(
    estimated: Callable[..., Estimate], camera: Camera
) -> None:
    """Lamps keep their colours through the same camera."""
    flash, neutral = find_light("xenon"), find_light("D65")
    both = [
        estimated(by=build_model(camera, flash, neutral, "wpca", other)).changes
        for other in (camera, srgb_stand_in())
    ]

    same, other = (one for one in both if one is not None)
    np.testing.assert_allclose(same, np.stack([np.eye(3)] * 2), atol=1e-6)
    assert other.shape == (2, 3, 3)
    assert np.abs(other - np.eye(3)).max() > 0.1


def test_an_assumed_focal_length_is_warned_of_after_the_lamps(
    estimated: Callable[..., Estimate], warm_to_cool: Floats64
) -> None:
    given = {"count": 3, "light_directions": lit(warm_to_cool), "method": "paper"}

    assumed = estimated("normals.png", **given)
    told = estimated("normals.png", **given, focal_px=150.0)

    assert "focal_length_assumed" in [warning.code for warning in assumed.warnings]
    assert "focal_length_assumed" not in [warning.code for warning in told.warnings]
    assert assumed.facing is not None
    assert assumed.facing.strengths.shape == (3,)


def test_directions_for_pictures_alone_are_not_looked_at(
    estimated: Callable[..., Estimate], warm_to_cool: Floats64
) -> None:
    found = estimated("lamps.jpg", count=3, light_directions=lit(warm_to_cool))

    assert found.facing is None


def test_a_pinned_area_that_shows_nothing_is_refused(
    estimated: Callable[..., Estimate],
) -> None:
    with pytest.raises(OptionError, match="area of pinned lamp 1 is too small to tell a light"):
        estimated(pinned_lamps=[{"x": 20, "y": 10, "radius": 0.5}])


@pytest.mark.parametrize("method", ["best", "paper"])
def test_impossible_layers_are_told_of_the_method_that_makes_them(
    estimated: Callable[..., Estimate],
    monkeypatch: pytest.MonkeyPatch,
    method: Literal["best", "paper"],
) -> None:
    told = RunWarning(Code.LAYERS_IMPOSSIBLE, "They cannot be right.")
    monkeypatch.setattr(estimate_module, "doubts_of_published", lambda *_: [told])

    assert (told in estimated(method=method).warnings) == (method == "paper")


def test_a_lamp_that_was_brighter_with_the_flash_is_told_and_taken_off(
    shadowed: Callable[[Floats64], Any],
    estimate_two: Callable[[Pair], Estimate],
    warm_to_cool: Any,
) -> None:
    steady, bulb = shadowed(warm_to_cool[[0, 2]]), shadowed(warm_to_cool[:1])
    brighter = replace(steady, flash=steady.flash + np.float32(0.2) * bulb.no_flash)

    found, usual = (estimate_two(pair) for pair in (brighter, steady))

    told = [warning for warning in found.warnings if warning.code == "light_changed"]
    assert [warning.figures["lamp"] for warning in told] == [1]
    assert found.lamps.changes == pytest.approx([0.2, 0.0], abs=0.03)
    np.testing.assert_allclose(found.reduced.flash, usual.reduced.flash, rtol=0.05, atol=1e-4)
    assert usual.lamps.changes is None
    assert "light_changed" not in [warning.code for warning in usual.warnings]


@pytest.mark.parametrize("something_moved", [False, True])
def test_lamps_are_not_told_by_moved_shadows(
    shadowed: Callable[[Floats64], Any],
    estimate_two: Callable[[Pair], Estimate],
    warm_to_cool: Any,
    monkeypatch: pytest.MonkeyPatch,
    something_moved: bool,
) -> None:
    still, bulb = shadowed(warm_to_cool[[0, 2]]), shadowed(warm_to_cool[:1])
    there = np.zeros(still.unusable.shape, bool)
    there[:, 60:] = True
    surely = there.copy()
    surely[:, :70] = False
    flash = np.where(there[..., None], still.flash + np.float32(0.5) * bulb.no_flash, still.flash)
    pair = replace(still, flash=flash, moved=0.01 if something_moved else 0.001)
    asked: list[bool] = []
    usable: list[Mask] = []
    left_out: list[Mask | None] = []

    def found(_: Any, moved: bool) -> MovedShadows | None:
        asked.append(moved)
        return MovedShadows(there, surely, 0.3)

    def lamps_and_codes(pair: Any) -> tuple[Floats64, list[str]]:
        estimate = estimate_two(pair)
        assert estimate.lamps.changes is None
        left_out.append(estimate.left_out)
        usable.append(estimate.reduced.usable)
        return estimate.lamps.coefficients, [warning.code for warning in estimate.warnings]

    def lamps_of(some: ReducedPair, *rest: Any) -> Lamps:
        usable.append(some.usable)
        return estimate_lamps(some, *rest)

    usual, _ = lamps_and_codes(still)
    monkeypatch.setattr(estimate_module, "find_moved_shadows", found)
    monkeypatch.setattr(estimate_module, "estimate_lamps", lamps_of)
    coefficients, codes = lamps_and_codes(pair)

    assert asked == [something_moved]
    whole, *tried, kept = usable
    assert len(tried) > 0
    for one in tried:
        np.testing.assert_array_equal(one, whole & ~there)
    np.testing.assert_array_equal(kept, whole & ~surely)
    assert left_out[0] is None
    np.testing.assert_array_equal(left_out[1], surely)
    cosines = (coefficients * usual).sum(axis=1)
    assert np.degrees(np.arccos(np.minimum(cosines, 1))).max() < 2.0
    assert ("moved" in codes) != something_moved  # of a thing that moved the pair tells
    assert "light_changed" not in codes


def test_the_published_method_takes_shadows_as_they_are(
    estimated: Callable[..., Estimate], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delattr(estimate_module, "find_moved_shadows")

    assert len(estimated(method="paper").lamps) == 2

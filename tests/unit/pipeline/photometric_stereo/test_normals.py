from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.errors import OptionError
from pipeline.lamps.lamps import Lamps
from pipeline.light.model import Model
from pipeline.options import DirectedLight
from pipeline.pair.reduced import reduce_pair
from pipeline.photometric_stereo import normals
from pipeline.photometric_stereo.normals import find_facing
from pipeline.progress import Progress
from pipeline.run_warnings import Code
from pipeline.separation.separation import Strip
from pipeline.vectors import unit

DIRECTIONS = ((-0.6, 0.35, 0.7), (0.65, 0.3, 0.7), (0.05, -0.55, 0.8))


@pytest.fixture(scope="module")
def found(
    exact: Callable[..., tuple[Any, Floats64]],
    lamps_of: Callable[..., Lamps],
    model: Model,
    warm_to_cool: Floats64,
) -> Callable[..., Any]:
    """Find where surfaces face in a pair of three lamps; the strip is all of it."""

    @cache
    def run(method: Literal["best", "paper"], count: int = 3) -> tuple[Any, Strip]:
        pair, layers = exact(warm_to_cool)
        lights = [
            DirectedLight(direction=direction, rgb=tuple(colour))
            for direction, colour in zip(DIRECTIONS, warm_to_cool[:count], strict=False)
        ]
        reduced, lamps = reduce_pair(pair), lamps_of(warm_to_cool[:count])
        facing = find_facing(lights, reduced, lamps, model, 150.0, method, Progress())
        height, width = pair.unusable.shape
        strip = Strip(
            slice(0, height),
            layers.astype(np.float32),
            pair.no_flash,
            pair.flash - pair.no_flash,
            np.ones((height, width), np.float32),
        )
        return facing, strip

    return run


@pytest.mark.parametrize("method", ["best", "paper"])
def test_normals_are_of_unit_length_or_unknown(found: Callable[..., Any], method: str) -> None:
    facing, strip = found(method)

    normals = facing.normals_of(strip)

    known = np.isfinite(normals).all(axis=2)
    assert normals.shape == strip.no_flash.shape
    assert known.mean() > 0.05
    np.testing.assert_allclose(np.linalg.norm(normals[known], axis=1), 1, atol=1e-5)


def test_light_that_no_surface_explains_is_warned_of(found: Callable[..., Any]) -> None:
    """The shares of the lamps in this picture are not those of any surface."""
    warned = found("best")[0].warnings

    assert len(warned) == 1
    assert "do not explain the light" in warned[0].message
    assert "photograph things one at a time" in warned[0].message
    assert found("paper")[0].warnings == ()


@pytest.mark.parametrize(("degrees", "told"), [(5.9, 2), (6.1, 2), (5.9, 3)])
def test_lamps_alike_whose_colours_are_not_given_make_normals_doubtful(
    exact: Callable[..., tuple[Any, Floats64]],
    lamps_of: Callable[..., Lamps],
    model: Model,
    warm_to_cool: Floats64,
    monkeypatch: pytest.MonkeyPatch,
    degrees: float,
    told: int,
) -> None:
    """The colours of two of three lamps are given, or of all."""
    warm, green, cool = warm_to_cool
    aside, angle = unit(warm - (warm @ cool) * cool), np.radians(degrees)
    found = np.stack([green, cool, np.cos(angle) * cool + np.sin(angle) * aside])
    lights = [
        DirectedLight(direction=direction, rgb=tuple(colour) if index < told else None)
        for index, (direction, colour) in enumerate(zip(DIRECTIONS, warm_to_cool, strict=True))
    ]
    nowhere = {"mask": np.zeros((4, 4), np.bool_), "w": np.zeros((4, 4, 3))}
    surface = SimpleNamespace(
        misfit=0.0, unexplained=0.0, strengths=np.ones(3), turned_deg=0.0, **nowhere
    )
    monkeypatch.setattr(normals, "solve_surface", lambda *_: surface)
    reduced = reduce_pair(exact(warm_to_cool)[0])

    warnings = find_facing(
        lights, reduced, lamps_of(found), model, 150.0, "best", Progress()
    ).warnings

    doubtful = degrees < 6 and told < 3
    assert [warning.code for warning in warnings] == [Code.NORMALS_DOUBTFUL] * doubtful
    if doubtful:
        assert warnings[0].figures == {"angle_deg": pytest.approx(degrees, abs=0.01)}
        assert "Give the rgb of each lamp" in warnings[0].message


@pytest.mark.parametrize(
    ("misfit", "unexplained", "strengths", "why"),
    [
        (0.0499, 0.0699, (1.0, 0.2, 0.1), None),
        (0.05, 0.0, (1.0, 0.2, 0.1), "5% of it is left over"),
        (0.3, 0.0, (1.0, -0.5, 0.1), "30% of it is left over"),
        (0.001, 0.07, (1.0, 0.2, 0.1), "7% of the surface has light that they do not give"),
        (0.001, 0.0, (1.0, -0.5, 0.1), "one of them would have to take light away"),
        (0.001, 0.0, (1.0, 0.5, 0.0), "one of them would have to take light away"),
    ],
)
def test_a_warning_says_what_is_wrong(
    found: Any,
    monkeypatch: pytest.MonkeyPatch,
    misfit: float,
    unexplained: float,
    strengths: tuple[float, ...],
    why: str | None,
) -> None:
    surface = replace(
        found("best")[0].surface,
        misfit=misfit,
        unexplained=unexplained,
        strengths=np.array(strengths),
    )
    monkeypatch.setattr(normals, "solve_surface", lambda *_: surface)

    warned = found.__wrapped__("best")[0].warnings

    figures = {"left_over": misfit, "unexplained": unexplained}
    assert [warning.figures for warning in warned] == [figures] * (why is not None)
    assert all(str(why) in warning.message for warning in warned)


def test_a_surface_is_fitted_by_best_alone(found: Callable[..., Any]) -> None:
    assert found("best")[0].surface is not None
    assert found("paper")[0].surface is None


def test_two_lamps_will_do_for_best_alone(found: Callable[..., Any]) -> None:
    facing, strip = found("best", 2)

    assert np.isfinite(facing.normals_of(strip)).all(axis=2).mean() > 0.5
    with pytest.raises(OptionError, match="published normals need three light directions"):
        found("paper", 2)


@pytest.mark.parametrize(("degrees", "warned"), [(0.0, False), (0.99, False), (9.7, True)])
def test_directions_that_the_light_turned_are_warned_of(
    found: Callable[..., Any], degrees: float, warned: bool
) -> None:
    surface = found("best")[0].surface
    right = {"misfit": 0.0, "unexplained": 0.0, "strengths": np.ones(3)}

    warnings = normals._warnings(replace(surface, **right, turned_deg=degrees))

    assert [(one.code, one.figures) for one in warnings] == [
        (Code.NORMALS_DOUBTFUL, {"turned_deg": degrees})
    ] * warned
    assert all("directions up to 10° beside those given" in one.message for one in warnings)


@pytest.mark.parametrize(("turned", "warned"), [(0.0, False), (-0.04, False), (-0.06, True)])
def test_a_surface_inside_out_is_warned_of(
    found: Callable[..., Any], monkeypatch: pytest.MonkeyPatch, turned: float, warned: bool
) -> None:
    right = {"misfit": 0.0, "unexplained": 0.0, "strengths": np.ones(3), "turned_deg": 0.0}
    surface = replace(found("best")[0].surface, **right)
    given = {(id(surface.mask), id(surface.w)): turned}
    monkeypatch.setattr(normals, "turns_away", lambda mask, w: given[id(mask), id(w)])

    warnings = normals._warnings(surface)

    assert [(one.code, one.figures) for one in warnings] == [
        (Code.NORMALS_DOUBTFUL, {"turned_away": turned})
    ] * warned
    assert all("x right, y up and z to the camera" in one.message for one in warnings)

from __future__ import annotations

from collections.abc import Callable
from itertools import permutations
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.calibration.lamps import LampsEstimate, estimate_lamps
from pipeline.errors import OptionError, UnusablePairError
from pipeline.options import Circle
from pipeline.pair import Pair
from pipeline.vectors import unit
from tests.targets import CIRCLE, FOCAL_PX, photograph_sphere

Array = NDArray[np.float64]
THREE = unit(np.array([(-0.9, 0.3, 0.2), (0.2, 0.7, 0.6), (0.7, -0.5, 0.4)]))
COLOURS = np.array([(0.3, 0.2, 0.1), (0.25, 0.2, 0.12), (0.2, 0.25, 0.15)])
FLASH = np.array([0.8, 1.0, 0.6])
MARKED = Circle(**CIRCLE)


def _errors(found: LampsEstimate, directions: Array) -> tuple[Array, tuple[int, ...]]:
    """Angles in degrees in the best order, and which lamp found is each."""
    angles = np.degrees(np.arccos(np.clip(directions @ found.directions.T, -1, 1)))
    rows = np.arange(len(directions))
    order = min(permutations(rows), key=lambda order: angles[rows, list(order)].sum())
    return angles[rows, list(order)], tuple(int(i) for i in order)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_exact_light_gives_exact_lamps(pair_of: Callable[..., Pair], count: int) -> None:
    pair = pair_of(photograph_sphere(THREE[:count], COLOURS[:count]))
    found = estimate_lamps(pair, MARKED, "auto", FOCAL_PX)
    assert len(found.directions) == count
    errors, order = _errors(found, THREE[:count])
    assert errors == pytest.approx(0, abs=0.1)
    # the strongest green comes first
    assert (np.diff(found.colours[:, 1]) <= 1e-9).all()
    ratio = found.colours[list(order)] / COLOURS[:count]
    assert ratio / ratio[0, 0] == pytest.approx(np.ones((count, 3)), rel=0.01)
    assert found.misfit < 0.002
    assert found.flash_aside_deg < 0.1


def test_an_outline_marked_aside_is_mended(pair_of: Callable[..., Pair]) -> None:
    pair = pair_of(photograph_sphere(THREE, COLOURS))
    true = estimate_lamps(pair, MARKED, 3, FOCAL_PX).circle
    aside = Circle(x=MARKED.x + 1.5, y=MARKED.y - 1, radius=MARKED.radius - 1.2)
    found = estimate_lamps(pair, aside, 3, FOCAL_PX)
    assert _errors(found, THREE)[0] == pytest.approx(0, abs=0.2)
    for name in ("x", "y", "radius"):
        assert getattr(found.circle, name) == pytest.approx(getattr(true, name), abs=0.05)


def test_a_flash_beside_the_lens_is_seen_and_allowed_for(pair_of: Callable[..., Pair]) -> None:
    pair = pair_of(photograph_sphere(THREE, COLOURS, flash_at=(0.1, 0.0)))
    found = estimate_lamps(pair, MARKED, 3, FOCAL_PX)
    assert found.flash_aside_deg == pytest.approx(np.degrees(np.arctan(0.1)), abs=0.1)
    assert _errors(found, THREE)[0] == pytest.approx(0, abs=0.1)


def test_noise_and_uneven_paint_cost_little(pair_of: Callable[..., Pair]) -> None:
    pair = pair_of(photograph_sphere(THREE, COLOURS, noise=1.0, paint=0.05))
    found = estimate_lamps(pair, MARKED, "auto", FOCAL_PX)
    errors, order = _errors(found, THREE)
    assert errors.max() < 0.6
    deviations = found.deviations_deg[list(order)]
    assert (errors < 5 * deviations + 0.05).all()
    assert (deviations < 1).all()


def test_paint_of_two_greys_is_told_from_shading(pair_of: Callable[..., Pair]) -> None:
    shot = photograph_sphere(THREE[:2], COLOURS[:2])
    stripes = np.where(np.arange(360) // 4 % 2, 1.0, 0.93)[None, :, None]
    painted = pair_of(
        shot,
        no_flash=(shot.frames[0] * stripes).astype(np.float32),
        flash=(shot.frames[1] * stripes).astype(np.float32),
    )
    found = estimate_lamps(painted, MARKED, 2, FOCAL_PX)
    assert _errors(found, THREE[:2])[0].max() < 0.3


def test_lamps_too_alike_are_refused(pair_of: Callable[..., Pair]) -> None:
    close = unit(np.array([(0.30, 0.2, 1.0), (0.33, 0.22, 1.0)]))
    pair = pair_of(photograph_sphere(close, COLOURS[:1].repeat(2, axis=0), noise=1.0))
    with pytest.raises(UnusablePairError, match="lamps cannot be told apart"):
        estimate_lamps(pair, MARKED, 2, FOCAL_PX)


def test_light_that_no_distant_lamps_give_is_refused(pair_of: Callable[..., Pair]) -> None:
    shot = photograph_sphere(THREE[:2], COLOURS[:2])
    y, x = np.mgrid[:240, :360]
    blotches = (1 + 0.6 * np.sin(x / 6.0) * np.sin(y / 7.0))[..., None]
    frames = shot.frames[0] * blotches, shot.frames[0] * blotches + shot.frames[1]
    pair = pair_of(shot, no_flash=frames[0].astype(np.float32), flash=frames[1].astype(np.float32))
    with pytest.raises(UnusablePairError, match="Distant lamps do not explain"):
        estimate_lamps(pair, MARKED, "auto", FOCAL_PX)


@pytest.mark.parametrize(
    ("circle", "error", "words"),
    [
        (Circle(x=60, y=60, radius=40), UnusablePairError, "not the outline of a matt sphere"),
        (Circle(x=20, y=60, radius=40), OptionError, "not wholly inside the photograph"),
        (Circle(x=196, y=112, radius=11), OptionError, "radius of only 11 pixels"),
    ],
)
def test_circles_without_a_sphere_are_refused(
    pair_of: Callable[..., Pair], circle: Circle, error: type[Exception], words: str
) -> None:
    pair = pair_of(photograph_sphere(THREE, COLOURS))
    with pytest.raises(error, match=words):
        estimate_lamps(pair, circle, 3, FOCAL_PX)


def test_a_clipped_sphere_is_refused(pair_of: Callable[..., Pair]) -> None:
    clipped: Any = np.zeros((240, 360), bool)
    clipped[:100] = True
    pair = pair_of(photograph_sphere(THREE, COLOURS), unusable=clipped)
    with pytest.raises(UnusablePairError, match="sphere is clipped"):
        estimate_lamps(pair, MARKED, 3, FOCAL_PX)

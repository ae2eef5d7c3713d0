from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.light.model import Model
from pipeline.pair.reduced import ReducedPair, reduce_pair
from pipeline.separation.pure_light import without_pure_light

Build = Callable[..., Any]


@pytest.fixture
def lit(model: Model, flash_part: Floats64, pair_of: Build) -> Callable[..., ReducedPair]:
    """Light the patches by lamps (N, 3) in given shares (N, 64, 96)."""

    def build(coefficients: Floats64, shares: Floats64) -> ReducedPair:
        matrices = model.lamp_matrix(coefficients)
        light = np.einsum("nhw,nkl,hwl->hwk", shares, matrices, flash_part.astype(np.float64))
        return reduce_pair(pair_of(light, flash_part))

    return build


@pytest.fixture
def two(lamps_of: Build, warm_to_cool: Floats64) -> Any:
    """Two lamps that cast no shadow."""
    return lamps_of(warm_to_cool[[0, 2]], alone=np.zeros(2))


def mixture(warm_least: float, warm_most: float) -> Floats64:
    """Shares of a warm lamp that bulge in the middle of the picture, the rest of a cool one."""
    v, u = np.mgrid[-1:1:64j, -1:1:96j]
    bulge = np.exp(-2 * (u**2 + v**2))
    bulge = (bulge - bulge.min()) / (bulge.max() - bulge.min())
    warm = warm_least + (warm_most - warm_least) * bulge
    return np.stack([warm, 1 - warm])


def test_mixtures_show_no_lamp_alone(lit: Build, two: Any) -> None:
    reduced = lit(two.coefficients, mixture(0.2, 0.8))

    assert without_pure_light(reduced, two) == [0, 1]


def test_a_rim_at_the_outline_is_not_an_area(lit: Build, two: Any) -> None:
    """A fit takes the outermost mixtures for its lamps: only one point of each is all its own."""
    reduced = lit(two.coefficients, mixture(0.0, 1.0))

    assert without_pure_light(reduced, two) == [0, 1]


@pytest.mark.parametrize(("height", "width", "hidden"), [(8, 11, [0, 1]), (8, 12, [1])])
def test_a_tiny_area_tells_no_lamp(
    lit: Build, two: Any, height: int, width: int, hidden: list[int]
) -> None:
    """Of 88 pixels, and of 96: 0.0156 of the picture."""
    shares = mixture(0.2, 0.8)
    shares[0, :height, :width], shares[1, :height, :width] = 1.0, 0.0

    assert without_pure_light(lit(two.coefficients, shares), two) == hidden


@pytest.mark.parametrize(
    ("share", "others", "hidden"), [(0.92, (0.05, 0.1), [1]), (0.955, (0.01, 0.05), [0, 1])]
)
def test_an_area_goes_with_much_that_is_nearly_of_the_lamp(
    lit: Build, two: Any, share: float, others: tuple[float, float], hidden: list[int]
) -> None:
    """A tenth alone beside a fifth that holds some of the other; below a twentieth that hides it.

    By its light: the mean of what it is in the channels is more than a twentieth both times.
    """
    shares = mixture(0.2, 0.8)
    shares[:, :, :30] = np.array([share, 1 - share])[:, None, None]
    shares[:, :, :10] = np.array([1.0, 0.0])[:, None, None]
    light = lit(two.coefficients, shares)
    by_light = (two.matrices @ light.flash[0, 20]).sum(axis=1) * [share, 1 - share]
    assert others[0] < by_light[1] / by_light.sum() < others[1]

    assert without_pure_light(light, two) == hidden


def test_stray_pixels_beyond_an_area_do_not_hide_it(lit: Build, two: Any) -> None:
    """Three in a thousand, of a lamp found a little off."""
    shares = mixture(0.2, 0.8)
    shares[:, :20, :20] = np.array([0.98, 0.02])[:, None, None]
    shares[:, 60, 60:78] = np.array([1.0, 0.0])[:, None]

    assert without_pure_light(lit(two.coefficients, shares), two) == [1]


def test_an_area_that_is_not_usable_tells_nothing(lit: Build, two: Any) -> None:
    shares = mixture(0.2, 0.8)
    shares[0, :20, :20], shares[1, :20, :20] = 1.0, 0.0
    reduced = lit(two.coefficients, shares)
    usable = reduced.usable.copy()
    usable[:20, :20] = False

    assert without_pure_light(replace(reduced, usable=usable), two) == [0, 1]


@pytest.mark.parametrize("lamp", [0, 1])
def test_an_area_of_one_lamp_tells_that_lamp(lit: Build, two: Any, lamp: int) -> None:
    shares = mixture(0.2, 0.8)
    shares[lamp, :20, :20], shares[1 - lamp, :20, :20] = 1.0, 0.0

    assert without_pure_light(lit(two.coefficients, shares), two) == [1 - lamp]


def test_edges_of_shadows_tell_a_lamp(lit: Build, lamps_of: Build, warm_to_cool: Floats64) -> None:
    lamps = lamps_of(warm_to_cool[[0, 2]], alone=np.array([0.0011, 0.0009]))

    assert without_pure_light(lit(lamps.coefficients, mixture(0.2, 0.8)), lamps) == [1]


def test_one_lamp_is_always_alone(lit: Build, lamps_of: Build, warm_to_cool: Floats64) -> None:
    lamps = lamps_of(warm_to_cool[:1], alone=np.zeros(1))

    assert without_pure_light(lit(lamps.coefficients, np.ones((1, 64, 96))), lamps) == []


def test_a_lamp_found_a_little_off_is_still_seen_alone(
    lit: Build, lamps_of: Build, warm_to_cool: Floats64
) -> None:
    """Pixels of one lamp then hold some of the other by the wrong lamps, all of them as much."""
    warm, _, cool = warm_to_cool
    true = np.stack([0.98 * warm + 0.02 * cool, 0.02 * warm + 0.98 * cool])
    shares = mixture(0.2, 0.8)
    shares[:, :20, :20] = np.array([1.0, 0.0])[:, None, None]
    shares[:, 40:, 60:] = np.array([0.0, 1.0])[:, None, None]

    found = without_pure_light(lit(true, shares), lamps_of(warm_to_cool[[0, 2]], alone=np.zeros(2)))

    assert found == []


def test_stray_pixels_beyond_an_area_hide_it_not(lit: Build, two: Any) -> None:
    """A fifth is the warm lamp's but for .025, since that lamp was found a little off."""
    shares = mixture(0.2, 0.8)
    shares[:, :, :20] = np.array([0.975, 0.025])[:, None, None]
    shares[:, :, 20] = np.array([1.0, 0.0])[:, None]

    assert without_pure_light(lit(two.coefficients, shares), two) == [1]

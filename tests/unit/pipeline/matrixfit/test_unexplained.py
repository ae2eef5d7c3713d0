from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pipeline.matrixfit.chromaticities import Chromaticities, nothing
from pipeline.matrixfit.evidence import Evidence
from pipeline.matrixfit.unexplained import (
    _left_of_pixels,
    left_over,
    mean_left_over,
    places_alone,
    share_beside,
    share_of_third,
    share_off,
    share_outside,
    shares_alone,
    unexplained,
)
from pipeline.pair.reduced import ReducedPair
from tests.definitions.unexplained import left_of_pixels

GREY = np.full(3, 1 / 3)
CORNERS = ((0.2, 0.2), (0.6, 0.2), (0.2, 0.6))
LAMPS = np.array([3 * np.diag([r, g, 1 - r - g]) for r, g in CORNERS])


def on_grey(*points: tuple[float, float], deviation: float = 0.001) -> Chromaticities:
    n = len(points)
    covariance = np.tile([deviation**2, 0.0, deviation**2], (n, 1))
    return Chromaticities(
        np.tile(GREY, (n, 1)), np.array(points).reshape(-1, 2), covariance, np.ones(n)
    )


def off_by(d: float, share: float = 1.0, variance: float = 0.0) -> ReducedPair:
    """Grey light of half the flash, red less and green more, or the reverse, in some pixels."""
    no_flash = np.full((20, 50, 3), 0.5, np.float32)
    off = no_flash.reshape(-1, 3)[: round(1000 * share)]
    off[::2] += (d, -d, 0)
    off[1::2] -= (d, -d, 0)
    noise = np.full_like(no_flash, variance)
    usable = np.ones((20, 50), bool)
    return ReducedPair(no_flash, np.ones_like(no_flash), noise, noise, usable, 1, False)


@pytest.mark.parametrize("d", [0.0, 0.03, 0.15])
def test_light_left_over_is_what_lamps_cannot_give(d: float) -> None:
    """One grey lamp explains 1.5 of the light, and leaves ±d in two channels."""
    assert left_over(off_by(d), np.eye(3)[None]) == pytest.approx(2 * d / 1.5, abs=1e-5)


@pytest.mark.parametrize(("share", "left"), [(0.08, 0.0), (0.12, 0.2)])
def test_a_tenth_of_the_light_tells(share: float, left: float) -> None:
    assert left_over(off_by(0.15, share), np.eye(3)[None]) == pytest.approx(left, abs=1e-4)


@pytest.mark.parametrize(("noise", "left"), [(0.12, 0.16), (0.25, 0.0)])
def test_noise_is_not_left_over(noise: float, left: float) -> None:
    """Of 0.2 left, noise that is 0.12 of the light leaves √(0.2² − 0.12²)."""
    pair = off_by(0.15, variance=(noise * 1.5) ** 2 / 3)
    without = replace(pair, flash_variance=np.zeros_like(pair.flash), flash_only=True)

    assert left_over(without, np.eye(3)[None]) == pytest.approx(left, abs=1e-4)


@pytest.mark.parametrize("flash_only", [False, True])
def test_what_lamps_make_of_a_weak_flashs_noise_is_not_left_over(flash_only: bool) -> None:
    """Lamps ten times the flash: of two thirds of the channels' noise one lamp leaves nothing."""
    pair = off_by(0.15, variance=1e-4)
    weak = replace(pair, flash=0.05 * pair.flash, flash_only=flash_only)
    # the photograph's, a hundred times the flash part's, and twice ten times what both share
    noise = 2 / 3 * 3 * 1e-4 * (1 + 100 + (0 if flash_only else 20)) / 1.5**2

    assert left_over(weak, np.eye(3)[None]) == pytest.approx(np.sqrt(0.2**2 - noise), abs=1e-4)


@pytest.mark.parametrize(("share", "variance"), [(1.0, 0.0), (0.25, 0.0), (0.5, 0.1)])
def test_all_light_left_over_counts_in_the_mean(share: float, variance: float) -> None:
    """±0.15 in two of three channels that hold 1.5, in a share of the pixels."""
    found = mean_left_over(off_by(0.15, share, variance), np.eye(3)[None])

    assert found == pytest.approx(share * 0.3 / 1.5, abs=1e-5)


def test_two_lamps_leave_what_neither_gives() -> None:
    """Lamps of red and green together, and blue, explain any mixture of theirs."""
    pair = off_by(0.0)
    pair.no_flash[::2, :, 2] = 0.1
    yellow_and_blue = np.array([np.diag([1.0, 1.0, 0.0]), np.diag([0.0, 0.0, 1.0])])

    assert left_over(pair, yellow_and_blue) == pytest.approx(0, abs=1e-5)
    assert left_over(pair, np.eye(3)[None]) > 0.1


@pytest.mark.parametrize("flash_only", [False, True])
@pytest.mark.parametrize("lamps", [1, 2, 3])
def test_loops_leave_what_the_definition_leaves(lamps: int, flash_only: bool) -> None:
    rng = np.random.default_rng(lamps)
    flash, no_flash = rng.uniform(0.05, 0.5, (2, 20, 30, 3)).astype(np.float32)
    variances = rng.uniform(1e-6, 1e-4, (2, 20, 30, 3)).astype(np.float32)
    usable = rng.random((20, 30)) < 0.9
    matrices = np.stack([np.diag(one) for one in rng.uniform(0.2, 1.0, (lamps, 3))]) - 0.02
    facts: Any = {"block": 4, "rendered": False, "flash_only": flash_only}
    pair = ReducedPair(no_flash, flash, variances[0], variances[1], usable, **facts)

    found = _left_of_pixels(pair, matrices)

    for one, defined in zip(found, left_of_pixels(pair, matrices), strict=True):
        np.testing.assert_allclose(one, defined, rtol=2e-4, atol=1e-6)


@pytest.mark.parametrize(
    ("d", "share", "deviation", "found"),
    [
        (0.0, 1.0, 0.0, 0.0),
        (0.006, 1.0, 0.0, 0.0),
        (0.008, 0.3, 0.0, 0.3),
        (0.1, 0.3, 0.02, 0.3),
        (0.1, 0.3, 0.04, 0.0),
    ],
)
def test_light_that_is_no_mixture_of_two_lamps_is_told(
    d: float, share: float, deviation: float, found: float
) -> None:
    """Of grey light ±d lies 1.4·d beside what a warm and a cool lamp mix to; noise may do that."""
    two = np.array([np.diag([1.5, 1.0, 0.5]), np.diag([0.5, 1.0, 1.5])])

    assert share_beside(off_by(d, share, deviation**2), two) == pytest.approx(found, abs=0.002)


def test_what_noise_both_photographs_share_lies_beside_the_plane_twice() -> None:
    """Light that lies .14 beside it: three standard deviations are more if noise is shared."""
    two = np.array([np.diag([1.5, 1.0, 0.5]), np.diag([0.5, 1.0, 1.5])])
    pair = off_by(0.1, 0.3, 0.024**2)
    bright = replace(pair, flash=0.5 * pair.flash)

    assert share_beside(replace(bright, flash_only=True), two) == pytest.approx(0.3, abs=0.002)
    assert share_beside(bright, two) == 0


def test_lamps_that_are_alike_have_no_plane_beside_which_light_lies() -> None:
    grey = np.eye(3)

    assert share_beside(off_by(0.1), np.array([grey, grey + 1e-4 * np.diag([1, 0, -1])])) == 0


def test_unusable_pixels_are_not_looked_at() -> None:
    pair = off_by(0.15, 0.5)
    usable = np.zeros((20, 50), bool)
    usable[10:] = True

    assert left_over(replace(pair, usable=usable), np.eye(3)[None]) == pytest.approx(0, abs=1e-5)


def test_differences_off_all_lamps_are_counted() -> None:
    at_lamps = ((0.2, 0.2), (0.6, 0.225), (0.2, 0.57))
    off = ((0.4, 0.2), (0.25, 0.2))

    assert share_off(on_grey(*at_lamps), LAMPS) == 0
    assert share_off(on_grey(*at_lamps, *off), LAMPS) == pytest.approx(0.4)
    assert share_off(on_grey(*off, deviation=0.02), LAMPS) == pytest.approx(0.5)
    assert share_off(on_grey(), LAMPS) == 0


def test_a_third_lamp_is_told_by_what_is_no_exchange_of_two() -> None:
    """Lamps at red .2 and .6, green .2: what lies on their line beyond either is an exchange."""
    two = LAMPS[:2]
    exchanged = ((0.08, 0.2), (0.75, 0.21), (0.9, 0.19))
    others = ((0.4, 0.2), (0.75, 0.3), (0.2, 0.6))

    assert share_of_third(on_grey((0.2, 0.2), (0.61, 0.19), *exchanged), two) == 0
    assert share_of_third(on_grey(*exchanged, *others), two) == pytest.approx(0.5)
    assert share_of_third(on_grey((0.75, 0.22), deviation=0.02), two) == 1
    assert share_of_third(on_grey(), two) == 0


def test_lamps_that_are_nearly_one_exchange_nothing() -> None:
    two = np.array([LAMPS[0], 3 * np.diag([0.22, 0.2, 0.58])])

    assert share_of_third(on_grey((0.6, 0.2), (0.21, 0.2)), two) == pytest.approx(0.5)


@pytest.mark.parametrize("order", [(0, 1, 2), (0, 2, 1)])
def test_pixels_outside_the_triangle_are_counted(order: tuple[int, ...]) -> None:
    lamps = LAMPS[list(order)]
    inside = ((0.3, 0.3), (0.2, 0.4), (0.4, 0.197))
    outside = ((0.4, 0.19), (0.45, 0.45))

    assert share_outside(on_grey(*inside), lamps) == 0
    assert share_outside(on_grey(*inside, *outside), lamps) == pytest.approx(0.4)
    assert share_outside(on_grey(*outside, deviation=0.02), lamps) == pytest.approx(0.5)


def test_signs_add_up() -> None:
    """Nothing left over, 0.4 of the differences off and 0.5 of the pixels outside."""
    differences = on_grey((0.2, 0.2), (0.6, 0.2), (0.2, 0.6), (0.4, 0.2), (0.25, 0.2))
    evidence = Evidence(
        on_grey((0.3, 0.3), (0.45, 0.45)), differences, nothing(), nothing(), 0.1, 0.0
    )

    assert unexplained(off_by(0.0), evidence, LAMPS) == pytest.approx(
        0.4 / 0.4 + 0.5 / 0.1, abs=1e-3
    )


def test_differences_are_counted_for_the_lamp_they_show() -> None:
    shown = ((0.2, 0.2), (0.6, 0.225), (0.6, 0.2), (0.2, 0.57))

    found = shares_alone(on_grey(*shown, (0.4, 0.2)), LAMPS)

    np.testing.assert_allclose(found, [0.2, 0.4, 0.2])
    np.testing.assert_array_equal(shares_alone(on_grey(), LAMPS), np.zeros(3))


def test_places_that_show_a_lamp_alone_are_edges_and_a_fifth_of_terminators() -> None:
    """Of the edges in a tenth of the picture, and of the terminators in a twentieth."""
    edges, bends = on_grey((0.2, 0.2), (0.4, 0.2)), on_grey((0.6, 0.2), (0.2, 0.2))
    evidence = Evidence(nothing(), edges, bends, nothing(), 0.1, 0.05)

    found = places_alone(evidence, LAMPS)

    np.testing.assert_allclose(found, [0.05 + 0.005, 0.005, 0.0])

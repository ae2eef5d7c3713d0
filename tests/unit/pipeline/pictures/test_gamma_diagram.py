from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.arrays import Floats64
from pipeline.light.model import Model
from pipeline.pair.reduced import ReducedPair
from pipeline.pictures.gamma_diagram import LEGEND, SIDE, draw_gamma_diagram

Picture = NDArray[np.uint8]

RADIUS = 15
PRUNED = (125, 80, 215)


def reduced_of(gammas: Floats64, model: Model, unusable: int = 0) -> ReducedPair:
    """A reduced pair (n, 1) whose pixels have these invariants, some more being unusable."""
    flash = np.tile([0.3, 0.5, 0.4], (len(gammas) + unusable, 1))
    light = np.concatenate([gammas, np.tile([0.1, 0.1, 0.9], (unusable, 1))])
    no_flash = np.einsum("klj,nj,nl->nk", model.tensor, light, flash)
    before, part = (plane[:, None].astype(np.float32) for plane in (no_flash, flash))
    quiet = np.full_like(part, 1e-12)
    usable = (np.arange(len(light)) < len(gammas))[:, None]
    return ReducedPair(before, part, quiet, quiet, usable, 1, False)


@pytest.fixture
def mixtures() -> Callable[[Floats64], Floats64]:
    """Unit mixtures (n, 3) of the lamps."""

    def build(corners: Floats64) -> Floats64:
        z = np.random.default_rng(1).dirichlet(np.ones(len(corners)), 3000)
        mixed = z @ corners
        return np.asarray(mixed / np.linalg.norm(mixed, axis=1, keepdims=True))

    return build


@pytest.fixture
def drawn(
    model: Model, lamps_of: Callable[..., Any], mixtures: Callable[[Floats64], Floats64]
) -> Callable[..., Picture]:
    """Draw lamps, and invariants that are mixtures of them if no others are given.

    pruned: invariants (m, 3) that pruning took away. Without the legend unless that is asked for.
    """

    def draw(
        corners: Floats64,
        labels: list[str] | None = None,
        invariants: Floats64 | None = None,
        pruned: Floats64 | None = None,
        legend: bool = False,
        unusable: int = 0,
    ) -> Picture:
        gammas = mixtures(corners) if invariants is None else invariants
        names = [""] * len(corners) if labels is None else labels
        lamps = lamps_of(corners, invariants=gammas)
        everything = gammas if pruned is None else np.concatenate([gammas, pruned])
        reduced = reduced_of(everything, model, unusable)
        picture = draw_gamma_diagram(reduced, lamps, model, names)
        return picture if legend else picture[:SIDE]

    return draw


def circles(picture: Picture) -> Floats64:
    """Centers (n, 2) of light rings of the lamps' size, found by correlation."""
    ring = np.zeros((41, 41), np.float32)
    cv2.circle(ring, (20, 20), RADIUS, 1.0, 2, cv2.LINE_AA)
    bright = (picture.min(axis=2) > 200).astype(np.float32)
    score = cv2.matchTemplate(bright, ring, cv2.TM_CCORR_NORMED)
    found = []
    while score.max() > 0.75:
        y, x = np.unravel_index(int(score.argmax()), score.shape)
        found.append([x + 20, y + 20])
        score[max(y - 25, 0) : y + 25, max(x - 25, 0) : x + 25] = 0
    return np.array(found, dtype=np.float64)


def sides(points: Floats64) -> Floats64:
    """Lengths of a triangle's sides, sorted, the longest 1."""
    lengths = np.sort([np.linalg.norm(points[i] - points[i - 1]) for i in range(3)])
    return np.asarray(lengths / lengths[-1])


def test_the_picture_is_a_square_with_a_legend_and_of_eight_bits(
    drawn: Callable[..., Picture], warm_to_cool: Floats64
) -> None:
    picture = drawn(warm_to_cool, legend=True)

    assert (SIDE, LEGEND) == (900, 150)
    assert picture.shape == (1050, 900, 3)
    assert picture.dtype == np.uint8


@pytest.mark.parametrize("which", [(0,), (0, 2), (0, 1, 2)])
def test_every_lamp_has_its_circle_well_inside(
    drawn: Callable[..., Picture], warm_to_cool: Floats64, which: tuple[int, ...]
) -> None:
    found = circles(drawn(warm_to_cool[list(which)]))

    assert len(found) == len(which)
    assert (found > 60).all()
    assert (found < 840).all()


def test_three_circles_are_the_triangle_seen_from_the_middle_of_the_sphere(
    drawn: Callable[..., Picture], mixtures: Callable[[Floats64], Floats64], warm_to_cool: Floats64
) -> None:
    center = mixtures(warm_to_cool).mean(axis=0)
    center /= np.linalg.norm(center)
    in_plane = warm_to_cool / (warm_to_cool @ center)[:, None]

    found = circles(drawn(warm_to_cool))

    np.testing.assert_allclose(sides(found), sides(in_plane), atol=0.01)


def test_the_cloud_lies_in_the_triangle(
    drawn: Callable[..., Picture], warm_to_cool: Floats64
) -> None:
    picture = drawn(warm_to_cool)
    corners = circles(picture)
    inside = np.zeros(picture.shape[:2], np.uint8)
    cv2.fillConvexPoly(inside, corners.astype(np.int32), 1)
    grown = cv2.dilate(inside, np.ones((61, 61), np.uint8)) > 0
    grown[:50] = True  # the title
    grown[-60:, -300:] = True  # the scale

    coloured = np.ptp(picture.astype(int), axis=2) > 20

    assert not coloured[~grown].any()
    assert coloured[inside > 0].mean() > 0.05


def test_one_lamp_lies_amid_its_cloud(
    drawn: Callable[..., Picture], warm_to_cool: Floats64
) -> None:
    scattered = warm_to_cool[0] + np.random.default_rng(3).normal(0, 0.02, (2000, 3))
    unit = scattered / np.linalg.norm(scattered, axis=1, keepdims=True)

    (found,) = circles(drawn(warm_to_cool[:1], invariants=unit))

    np.testing.assert_allclose(found, [450, 450], atol=40)


def test_small_noise_is_not_blown_up_to_fill_the_picture(
    drawn: Callable[..., Picture], warm_to_cool: Floats64
) -> None:
    tight = warm_to_cool[0] + np.random.default_rng(3).normal(0, 0.002, (2000, 3))
    unit = tight / np.linalg.norm(tight, axis=1, keepdims=True)

    coloured = np.ptp(drawn(warm_to_cool[:1], invariants=unit).astype(int), axis=2) > 20

    rows, columns = np.nonzero(coloured)
    assert np.ptp(rows) < 200
    assert np.ptp(columns) < 200


def test_circles_have_the_colours_of_the_lamps(
    drawn: Callable[..., Picture], warm_to_cool: Floats64
) -> None:
    """Red to blue for bulb and sky, green for the green lamp."""
    picture = drawn(warm_to_cool)

    colours = np.array([picture[int(y) - 11, int(x)].astype(int) for x, y in circles(picture)])

    ordered = colours[np.argsort(colours[:, 0] - colours[:, 2])]
    blue, green, warm = ordered[0], colours[colours[:, 1] - colours[:, 0] > 0], ordered[-1]
    assert blue[2] == 255
    assert blue[0] < 230
    assert warm[0] == 255
    assert warm[2] < 200
    assert any(one[1] == 255 and one[0] < 250 and one[2] < 250 for one in green)


def test_daylight_is_shown_white(drawn: Callable[..., Picture], model: Model) -> None:
    daylight = (model.neutral / np.linalg.norm(model.neutral))[None]

    picture = drawn(daylight, invariants=np.repeat(daylight, 50, axis=0))

    assert picture[450 - 11, 450].min() > 235  # above the number


def test_each_lamp_has_its_number(drawn: Callable[..., Picture], warm_to_cool: Floats64) -> None:
    """Dark strokes inside the circles, more of them for a 2 than for a 1."""
    picture = drawn(warm_to_cool[[0, 2]])

    dark = [
        int((picture[int(y) - 10 : int(y) + 11, int(x) - 10 : int(x) + 11].max(axis=2) < 90).sum())
        for x, y in sorted(
            circles(picture).tolist(), key=lambda at: int(picture[int(at[1]) - 12, int(at[0]), 2])
        )
    ]

    assert 10 < dark[0] < dark[1] < 120


def test_pruned_light_is_violet_and_the_legend_says_how_much(
    drawn: Callable[..., Picture], warm_to_cool: Floats64
) -> None:
    """A tight bunch of 1,000 off the line of 3,000, and the same bunch when it is kept."""
    two = warm_to_cool[[0, 2]]
    mixed = np.random.default_rng(1).dirichlet(np.ones(2), 3000) @ two
    kept = mixed / np.linalg.norm(mixed, axis=1, keepdims=True)
    bunch = two.mean(axis=0) + np.array([0.0, 0.06, 0.0])
    bunch = np.repeat(bunch[None] / np.linalg.norm(bunch), 1000, axis=0)

    pruned = drawn(two, invariants=kept, pruned=bunch)
    whole = drawn(two, invariants=np.concatenate([kept, bunch]))

    violet = (pruned == PRUNED).all(axis=2)
    assert violet.sum() == 9  # one bin of 3 × 3 pixels
    assert not (whole == PRUNED).all(axis=2).any()
    other = drawn(two, invariants=kept, pruned=bunch[:10], legend=True)[SIDE:]
    assert (drawn(two, invariants=kept, pruned=bunch, legend=True)[SIDE:] != other).any()


def test_fuller_bins_are_brighter_by_the_logarithm(
    drawn: Callable[..., Picture], warm_to_cool: Floats64
) -> None:
    """Spots of 1, 10 and 100 pixels: from three tenths of the colour in equal steps to all."""
    lamp = warm_to_cool[:1]
    at = lamp + np.array([[0.0, 0.06, 0.0], [0.0, 0.0, 0.06], [0.0, -0.06, 0.0]])
    at = at / np.linalg.norm(at, axis=1, keepdims=True)
    gammas = np.concatenate(
        [np.repeat(at[i : i + 1], n, axis=0) for i, n in enumerate((1, 10, 100))]
    )

    picture = drawn(lamp, invariants=gammas)

    spots = picture[:820].reshape(-1, 3).astype(float)
    circle = (
        np.linalg.norm(np.indices((820, 900)) - circles(picture)[0][::-1, None, None], axis=0) < 24
    )
    spots = spots[~circle.ravel()]
    spots = spots[(np.ptp(spots, axis=1) > 15)]
    colours, counts = np.unique(spots, axis=0, return_counts=True)
    strength = np.sort((colours[counts == 9][:, 0] - 28) / (255 - 28))
    np.testing.assert_allclose(strength, [0.3, 0.65, 1.0], atol=0.02)


def test_the_scale_is_as_long_as_its_degrees(
    drawn: Callable[..., Picture], warm_to_cool: Floats64
) -> None:
    """The smallest view is 2 · .12 of the tangent plane in 680 pixels; the bar is 2° there."""
    picture = drawn(warm_to_cool[:1], invariants=np.repeat(warm_to_cool[:1], 300, axis=0))

    bar = np.flatnonzero((picture[SIDE - 20] > 200).all(axis=1))

    assert np.ptp(bar) == pytest.approx(np.tan(np.radians(2)) * 340 / 0.12, abs=3)


def test_pixels_that_are_not_usable_are_not_drawn(
    drawn: Callable[..., Picture], warm_to_cool: Floats64
) -> None:
    plain = drawn(warm_to_cool, legend=True)

    np.testing.assert_array_equal(drawn(warm_to_cool, legend=True, unusable=500), plain)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_the_legend_has_words_and_colours(
    drawn: Callable[..., Picture], warm_to_cool: Floats64, count: int
) -> None:
    legend = drawn(warm_to_cool[:count], legend=True)[SIDE:]

    assert (legend == PRUNED).all(axis=2).sum() > 1000
    ramp = legend[24, 24:224, 0].astype(int)
    assert (np.diff(ramp) >= 0).all()
    assert ramp[0] < 100
    assert ramp[-1] == 255
    lines = (legend[:, 250:].min(axis=2) > 150).any(axis=1)
    assert int((np.diff(lines.astype(int)) == 1).sum()) >= 3


def test_labels_are_written_beside_the_circles(
    drawn: Callable[..., Picture], warm_to_cool: Floats64
) -> None:
    plain = drawn(warm_to_cool[[0, 2]])
    labelled = drawn(warm_to_cool[[0, 2]], ["lamp1, 2850 K", "lamp2, 12000 K"])

    changed = np.abs(labelled.astype(int) - plain).max(axis=2) > 50
    for x, y in circles(plain).astype(int):
        assert changed[max(y - 60, 0) : y + 60, max(x - 120, 0) : x + 120].any()
    np.testing.assert_allclose(circles(labelled), circles(plain), atol=1)


@pytest.mark.parametrize("turn", [0.0, 0.25, 0.5])
def test_labels_of_lamps_alike_hide_neither_each_other_nor_circles(
    drawn: Callable[..., Picture], warm_to_cool: Floats64, turn: float
) -> None:
    """Lamps 2° apart, in whatever direction: every label has the words that it has alone."""
    across = np.cross(warm_to_cool[0], [0.0, 0.0, 1.0])
    across /= np.linalg.norm(across)
    other = np.cross(warm_to_cool[0], across)
    away = np.cos(turn * np.pi) * across + np.sin(turn * np.pi) * other
    two = warm_to_cool[0] + np.array([[-0.0175], [0.0175]]) * away
    two /= np.linalg.norm(two, axis=1, keepdims=True)
    names = ["lamp1, incandescent 53%, 2691 K", "lamp2, white LED 50%, 2844 K"]

    def words(*labels: str) -> int:
        """Light pixels of the labels and all else, without a cloud behind them."""
        picture = drawn(two, list(labels), np.repeat(two[:1], 2, axis=0))
        return int((picture.min(axis=2) > 120).sum())

    bare = words("", "")
    alone = [words(names[0], "") - bare, words("", names[1]) - bare]

    assert min(alone) > 300
    assert words(*names) - bare == pytest.approx(sum(alone), rel=0.04)  # boxes hide the line


def test_long_labels_stay_in_the_picture(
    drawn: Callable[..., Picture], warm_to_cool: Floats64
) -> None:
    labelled = drawn(warm_to_cool[[0, 2]], ["lamp1 " * 9, "lamp2 " * 9])

    background = labelled[100, 4]
    assert (labelled[:, :6] == background).all()
    assert (labelled[:, -6:] == background).all()


def test_lamps_behind_the_cloud_do_no_harm(
    drawn: Callable[..., Picture], warm_to_cool: Floats64
) -> None:
    """Lamps of a degenerate estimate, far from all invariants."""
    odd = np.array([[-0.7, -0.65, -0.29], [0.0, 0.0, 1.0]])

    picture = drawn(odd, ["a", "b"], np.repeat(warm_to_cool[:1], 300, axis=0))

    assert picture.shape == (900, 900, 3)
    assert (picture != picture[100, 4]).any()


def test_equal_invariants_are_a_spot(drawn: Callable[..., Picture], warm_to_cool: Floats64) -> None:
    picture = drawn(warm_to_cool[:1], invariants=np.repeat(warm_to_cool[:1], 300, axis=0))

    (found,) = circles(picture)
    np.testing.assert_allclose(found, [450, 450], atol=2)


def test_every_lamp_needs_its_label(drawn: Callable[..., Picture], warm_to_cool: Floats64) -> None:
    with pytest.raises(ValueError, match="zip"):
        drawn(warm_to_cool, ["lamp1", "lamp2"])

from __future__ import annotations

import numpy as np
import pytest

from pipeline.arrays import Floats32
from pipeline.separation.fill_alike import fill_alike

WARM, COOL = (0.6, 0.3, 0.1), (0.2, 0.3, 0.5)
SHAPE = (32, 48)


def scene(brightness: float = 1.0) -> tuple[Floats32, Floats32, Floats32]:
    """A wall with value 1 in warm light, and from column 24 on a thing with 0 in cool light.

    Values, how much is known of them, and light; the gap is the wall's last eight columns.
    """
    values, light = np.ones((*SHAPE, 1), np.float32), np.empty((*SHAPE, 3), np.float32)
    light[:] = np.multiply(WARM, brightness)
    values[:, 24:], light[:, 24:] = 0.0, COOL
    known = np.ones(SHAPE, np.float32)
    known[:, 16:24] = 0.0
    return values, known, light


def half(values: Floats32) -> Floats32:
    """Fill gaps as what knows no light might."""
    return np.full_like(values, 0.5)


def test_a_gap_is_like_the_places_whose_light_is() -> None:
    values, known, light = scene()

    found = fill_alike(half(values), values, known, light, np.zeros_like(light))

    np.testing.assert_allclose(found[:, 16:24], 1, atol=0.05)


def test_only_gaps_are_filled() -> None:
    values, known, light = scene()
    filled = half(values)

    found = fill_alike(filled, values, known, light, np.zeros_like(light))

    np.testing.assert_array_equal(found[:, :16], 0.5)
    np.testing.assert_array_equal(found[:, 24:], 0.5)
    np.testing.assert_array_equal(filled, 0.5)


@pytest.mark.parametrize("gap", [(0.3, 0.6, 0.1), (30.0, 15.0, 5.0)])
def test_where_nothing_is_alike_gaps_stay(gap: tuple[float, ...]) -> None:
    """Neither in colour nor, fifty times as bright, in brightness."""
    values, known, light = scene()
    light[:, 16:24] = gap

    found = fill_alike(half(values), values, known, light, np.zeros_like(light))

    np.testing.assert_allclose(found, 0.5, atol=0.02)


def test_without_light_or_known_places_gaps_stay() -> None:
    values, known, light = scene()
    nothing = np.zeros_like(light)

    for one in (
        fill_alike(half(values), values, known, nothing, nothing),
        fill_alike(half(values), values, np.zeros_like(known), light, nothing),
    ):
        np.testing.assert_allclose(one, 0.5, rtol=1e-6)


def test_noise_makes_places_alike() -> None:
    """Twice as bright light is another light, unless noise is as large as light."""
    values, known, light = scene()
    light[:, 16:24] *= 2.5
    values[:, 24:] = 1.0
    light[:, 24:] = 0.0

    sure, unsure = (
        fill_alike(half(values), values, known, light, np.full_like(light, variance))
        for variance in (0.0, 0.3)
    )

    assert sure[:, 16:24].min() > 0.8
    assert (unsure - sure)[:, 16:24].min() > 0.0


def test_places_count_by_what_is_known_of_them() -> None:
    """Of two halves of a wall, above and below a gap in the middle, one is known by half."""
    values = np.zeros((33, 33, 1), np.float32)
    values[:16], values[17:] = 1.0, 0.0
    known = np.ones((33, 33), np.float32)
    known[16], known[17:] = 0.0, 0.5
    light = np.ones((33, 33, 3), np.float32)

    found = fill_alike(half(values), values, known, light, np.zeros_like(light))

    np.testing.assert_allclose(found[16, :, 0], 2 / 3, atol=5e-3)


def test_loops_do_what_is_defined() -> None:
    random = np.random.default_rng(3)
    values = random.random((20, 30, 6)).astype(np.float32)
    filled = random.random((20, 30, 6)).astype(np.float32)
    light = random.uniform(0.1, 0.3, (20, 30, 3)).astype(np.float32)
    variance = random.uniform(0, 1e-4, (20, 30, 3)).astype(np.float32)
    known = random.choice([0.0, 0.5, 1.0], (20, 30)).astype(np.float32)

    found = fill_alike(filled, values, known, light, variance)

    np.testing.assert_allclose(found, defined(filled, values, known, light, variance), 1e-5)


def defined(
    filled: Floats32, values: Floats32, known: Floats32, light: Floats32, variance: Floats32
) -> Floats32:
    """Gaps as the mean of places in rings around, weighed by exp(−apart² ÷ 2)."""
    total = light.sum(axis=2)
    noise = variance.sum(axis=2) / total**2
    found = filled.copy()
    for y, x in np.argwhere(known <= 0):
        places = set()
        for radius in (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128):
            for turn in 2 * np.pi * np.arange(16) / 16:
                places.add((y + round(radius * np.sin(turn)), x + round(radius * np.cos(turn))))
        v, u = np.array([(v, u) for v, u in places if 0 <= v < 20 and 0 <= u < 30]).T
        both = noise[y, x] + noise[v, u]
        colour = light[y, x] / total[y, x] - light[v, u] / total[v, u][:, None]
        apart = np.square(colour).sum(axis=1) / (0.03**2 + both)
        apart += np.log(total[y, x] / total[v, u]) ** 2 / (0.5**2 + both)
        weight = known[v, u] * np.exp(-apart / 2)
        summed = filled[y, x] + weight @ values[v, u]
        found[y, x] = summed / (1.0 + weight.sum())
    return found

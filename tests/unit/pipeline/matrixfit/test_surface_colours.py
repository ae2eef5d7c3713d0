"""What varies within one colour of surfaces under one lamp, and under two."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.matrixfit.surface_colours import scatter_within_colours
from tests.reduced_pairs import reduced_pair

HEIGHT, WIDTH, TILE = 60, 80, 5
ONE = np.diag([0.9, 0.7, 0.4])[None]


def paints(seed: int = 0, kinds: int = 24) -> tuple[Floats64, Floats64]:
    """Flash part (H, W, 3) of tiles of so many colours, and how far each is off the matrix."""
    rng = np.random.default_rng(seed)
    rows, columns = HEIGHT // TILE, WIDTH // TILE
    places = rng.permutation(rows * columns).reshape(rows, columns) % kinds
    colours = rng.uniform(0.1, 1, (kinds, 3))[places]
    flash: Floats64 = np.kron(colours, np.ones((TILE, TILE, 1))).astype(np.float64)
    return flash, 1 + 0.1 * np.sin(6 * flash / flash.sum(axis=2, keepdims=True))


def shade() -> Floats64:
    """From .3 on the left to 1 on the right, (1, W, 1)."""
    return np.linspace(0.3, 1, WIDTH)[None, :, None]


def test_paints_that_no_matrix_explains_are_off_alike_under_one_lamp() -> None:
    flash, off = paints()

    assert scatter_within_colours(reduced_pair(flash @ ONE[0] * off * shade(), flash), ONE) < 1e-4


def test_a_second_lamp_varies_within_a_colour() -> None:
    flash, off = paints()
    other = flash @ np.diag([0.5, 0.7, 0.8])
    light = (flash @ ONE[0] * shade() + other * (1.3 - shade())) * off
    mean = np.diag([0.7, 0.7, 0.6])[None]

    assert 0.1 < scatter_within_colours(reduced_pair(light, flash), mean) < 0.9


@pytest.mark.parametrize("kinds", [192, 12])
def test_colours_in_one_place_tell_nothing(kinds: int) -> None:
    """Each has a tile of its own, or a row of tiles: light that changes along it may be even."""
    flash, off = paints(kinds=192)
    if kinds == 12:
        flash, off = (np.repeat(x[:, :1], WIDTH, axis=1) for x in (flash, off))

    assert scatter_within_colours(reduced_pair(flash @ ONE[0] * off, flash), ONE) == 1


def test_within_one_colour_all_of_it_is_within_colours() -> None:
    """One surface, half of it in the light of another lamp: about their mean, of 4,800 pixels."""
    flash = np.full((HEIGHT, WIDTH, 3), 0.5)
    light = flash @ ONE[0]
    light[:, ::2] = flash[:, ::2] @ np.diag([0.5, 0.7, 0.8])
    mean = np.diag([0.7, 0.7, 0.6])[None]

    assert scatter_within_colours(reduced_pair(light, flash), mean) == pytest.approx(1, abs=0.1)


@pytest.mark.parametrize("scale", [1e-4, 1.0, 1e3])
def test_how_bright_the_pair_is_does_not_matter(scale: float) -> None:
    flash, off = paints(1)
    light = (flash @ ONE[0] * shade() + flash @ np.diag([0.5, 0.7, 0.8]) * (1.3 - shade())) * off

    found = scatter_within_colours(reduced_pair(scale * light, scale * flash), ONE)

    assert found == pytest.approx(scatter_within_colours(reduced_pair(light, flash), ONE), rel=1e-6)


def test_dark_pixels_have_no_say() -> None:
    flash, off = paints()
    light = flash @ ONE[0] * off * shade()
    noisy = np.random.default_rng(2).normal(0, 1e-3, light.shape)
    dark = np.arange(WIDTH) < WIDTH // 4
    flash[:, dark] *= 1e-3
    light[:, dark] = 1e-3 * light[:, dark] + noisy[:, dark]

    assert scatter_within_colours(reduced_pair(light, flash), ONE) < 1e-4


def test_bright_pixels_have_more_say() -> None:
    """A quarter of the light, in which alone a second lamp shines, counts for a sixteenth."""
    flash, off = paints()
    light = flash @ ONE[0] * off
    dim = np.arange(WIDTH) < WIDTH // 2
    other = flash @ np.diag([0.5, 0.7, 0.8])
    light[:, dim] = other[:, dim]
    dimmed = light.copy()
    dimmed[:, dim] /= 4

    even = scatter_within_colours(reduced_pair(light, flash), ONE)
    found = scatter_within_colours(reduced_pair(dimmed, flash), ONE)

    assert even > 0.3
    assert abs(found - even) > 0.05


def test_three_pixels_of_a_colour_tell_nothing() -> None:
    """Of each of 400 colours there are so many, in corners of the picture."""
    colours = np.random.default_rng(5).uniform(0.1, 1, (400, 3))
    flash = np.concatenate([colours, colours[::-1], colours]).reshape(30, 40, 3)

    assert scatter_within_colours(reduced_pair(flash @ ONE[0], flash), ONE) == 1


def test_colours_of_single_pixels_tell_nothing() -> None:
    flash = np.random.default_rng(3).uniform(0.1, 1, (10, 12, 3))

    assert scatter_within_colours(reduced_pair(flash @ ONE[0], flash), ONE) == 1

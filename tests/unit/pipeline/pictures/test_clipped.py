from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.pictures.clipped import shown_layers

WARM, COOL = np.array([1.0, 0.5, 0.2]), np.array([0.5, 1.0, 0.8])
WHITES = np.stack([WARM, COOL])


def shown(*layers: Any, whites: Any = WHITES, clipping: float = 1.0) -> Floats64:
    """Layers of one pixel as they are shown, (N, 3)."""
    given = np.array(layers, np.float32)[:, None, None]
    kept = given.copy()
    found = shown_layers(given, np.asarray(whites), clipping)
    np.testing.assert_array_equal(given, kept)
    assert found.shape == given.shape
    assert found.dtype == np.float32
    return np.asarray(found[:, 0, 0], np.float64)


def test_what_is_clipped_in_all_channels_has_its_lamps_colour_as_bright_as_the_brightest() -> None:
    np.testing.assert_allclose(shown((1, 1, 1), whites=[WARM]), [5 * WARM], rtol=1e-6)
    np.testing.assert_allclose(shown((1, 1, 1), whites=[COOL]), [2 * COOL], rtol=1e-6)


def test_each_layer_has_the_colour_of_its_own_lamp_as_far_as_the_sum_is_clipped() -> None:
    found = shown((0.75, 0.75, 0.75), (0.25, 0.25, 0.25))

    np.testing.assert_allclose(found, [3.75 * WARM, 0.5 * COOL], rtol=1e-6)
    unclipped = (0.5, 0.5, 0.5), (0.25, 0.25, 0.25)
    np.testing.assert_array_equal(shown(*unclipped), unclipped)


@pytest.mark.parametrize("light", [(0.95, 0.475, 0.19), (1, 0.5, 0.2), (1, 1, 0.4)])
def test_white_things_stay_as_they_are_up_to_where_they_are_clipped(light: Any) -> None:
    """Under a warm lamp: no step in brightness or colour where a second channel is clipped."""
    np.testing.assert_allclose(
        shown(light, whites=[WARM])[0] / WARM, np.full(3, np.max(light / WARM)), rtol=1e-6
    )


@pytest.mark.parametrize(("green", "share"), [(0.9, 0.0), (0.945, 0.5), (0.99, 1.0), (1.0, 1.0)])
def test_the_second_channel_says_how_far_light_is_clipped(green: float, share: float) -> None:
    light = np.array([1.0, green, 0.9])

    found = shown(light, whites=[(1.0, 1.0, 1.0)])

    np.testing.assert_allclose(found, (1 - share) * light[None] + share, rtol=1e-5)


@pytest.mark.parametrize(
    ("light", "whites"),
    [
        ((1.0, 1.0, 0.1), (1.0, 1.0, 1.0)),  # a yellow flower
        ((1.0, 1.0, 0.1), (1.0, 0.5, 0.2)),  # under a warm lamp, whose white has more blue
        ((0.2, 1.0, 1.0), (1.0, 1.0, 1.0)),
        ((1.0, 0.3, 0.2), (0.5, 1.0, 0.8)),
    ],
)
def test_what_the_third_channel_tells_to_be_coloured_stays_so(
    light: tuple[float, float, float], whites: Any
) -> None:
    np.testing.assert_allclose(shown(light, whites=[whites]), [light], rtol=1e-6)


def test_a_third_channel_near_the_two_tells_no_colour_whatever_the_lamp() -> None:
    """A window, whose light is not that of the lamp to which it was given."""
    light = np.array([0.85, 1.0, 1.0])

    np.testing.assert_allclose(shown(light, whites=[WARM]), [5 * WARM], rtol=1e-6)


@pytest.mark.parametrize(("green", "share"), [(0.9, 0.0), (0.945, 0.5), (1.0, 1.0)])
def test_a_channel_that_alone_is_clipped_is_no_less_than_the_next_one(
    green: float, share: float
) -> None:
    """What is white, a little over, under a lamp of much green would be pink."""
    white, light = np.array([0.6, 1.0, 0.5]), np.array([0.84, green, 0.75])
    expected = np.array([0.84, green + share * (1.4 - green), 0.75])

    np.testing.assert_allclose(shown(light, whites=[white]), [expected], rtol=1e-5)


def test_where_nothing_is_clipped_layers_are_shown_as_they_are() -> None:
    layers = np.full((2, 4, 5, 3), 3.0, np.float32)

    assert shown_layers(layers, WHITES, np.inf) is layers
    dark = layers / np.float32(10)
    assert shown_layers(dark, WHITES, 1.0) is dark
    np.testing.assert_array_equal(shown_layers(layers, WHITES, 10.0), layers)


def test_only_pixels_that_are_clipped_change() -> None:
    layers = np.full((1, 3, 4, 3), 0.5, np.float32)
    layers[0, 1, 2] = 1.0

    found = shown_layers(layers, WARM[None], 1.0)

    np.testing.assert_allclose(found[0, 1, 2], 5 * WARM, rtol=1e-6)
    found[0, 1, 2] = layers[0, 1, 2]
    np.testing.assert_array_equal(found, layers)


def test_a_pixel_without_light_of_a_lamp_has_none() -> None:
    found = shown((1, 1, 1), (0, 0, 0))

    np.testing.assert_allclose(found, np.stack([5 * WARM, 0 * COOL]), rtol=1e-6)

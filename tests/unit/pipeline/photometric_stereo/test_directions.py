from __future__ import annotations

import numpy as np
import pytest

from pipeline.errors import OptionError
from pipeline.options import DirectedLight, Vector
from pipeline.photometric_stereo.directions import likely_orders, unit_directions


def lights(*directions: Vector) -> list[DirectedLight]:
    return [DirectedLight(direction=one) for one in directions]


@pytest.mark.parametrize("count", [2, 3])
def test_directions_have_length_one(count: int) -> None:
    found = unit_directions(lights((3, 0, 4), (0, -5, 12), (-6, 8, 0))[:count])

    expected = [(0.6, 0, 0.8), (0, -5 / 13, 12 / 13), (-0.6, 0.8, 0)]
    np.testing.assert_allclose(found, expected[:count])


@pytest.mark.parametrize("length", [1e-300, 1e300])
def test_directions_may_be_of_any_length(length: float) -> None:
    found = unit_directions(lights((3 * length, 0, 4 * length), (0, -5, 12)))

    np.testing.assert_allclose(found, [(0.6, 0, 0.8), (0, -5 / 13, 12 / 13)])


@pytest.mark.parametrize(
    "directions",
    [
        ((1, 0, 1), (0, 0, 1), (-1, 0, 1)),
        ((-0.5, 0, 1), (0.5, 0, 1), (0.1, 0, 1)),
        ((0, 0, 1), (0, 0, 1), (0, 1, 1)),
        ((0, 0, 1), (0, 0, 2), (0, 0, 3)),
        ((0.01, 0, 1), (0, 0.01, 1), (-0.01, -0.01, 1)),
        ((0.1, 0.2, 0.9), (0.1, 0.2, 0.9)),
    ],
    ids=["fan", "fan aside", "two alike", "three alike", "from the camera", "two alike of two"],
)
def test_directions_that_fix_no_normals_are_refused(directions: tuple[Vector, ...]) -> None:
    with pytest.raises(OptionError, match="nearly alike, or lie nearly in one plane"):
        unit_directions(lights(*directions))


@pytest.mark.parametrize("count", [2, 3])
@pytest.mark.parametrize("z", [-0.7, 0.0])
def test_lamps_that_all_lie_behind_the_surface_are_refused(count: int, z: float) -> None:
    given = lights((-0.6, 0.3, z), (0.7, 0.4, -0.6), (0, -0.9, -1e-3))[:count]

    with pytest.raises(OptionError, match="z goes from the surface to the camera"):
        unit_directions(given)


def test_some_lamps_may_stand_behind_the_surface() -> None:
    found = unit_directions(lights((-3, 0, -4), (0, 5, 12)))

    np.testing.assert_allclose(found, [(-0.6, 0, -0.8), (0, 5 / 13, 12 / 13)])


WARM, GREEN, COOL = (1.0, 0.6, 0.2), (0.4, 1.0, 0.3), (0.3, 0.6, 1.0)


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ((None, None, None), [(0, 1, 2), (0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0)]),
        ((None, None, WARM), [(1, 2, 0), (2, 1, 0)]),
        ((COOL, None, None), [(2, 0, 1), (2, 1, 0)]),
        ((COOL, None, WARM), [(2, 1, 0)]),
        ((GREEN, COOL, WARM), [(1, 2, 0)]),
        ((None, COOL), [(0, 1)]),
        ((COOL, None), [(1, 0)]),
    ],
)
def test_a_colour_says_which_lamp_is_meant(
    given: tuple[Vector | None, ...], expected: list[tuple[int, ...]]
) -> None:
    """Of any brightness, and a little off."""
    whites = np.array([WARM, GREEN, COOL]) if len(given) == 3 else np.array([WARM, COOL])
    bright = np.arange(1, len(whites) + 1)[:, None] * whites * (1.1, 1.0, 0.95)
    said = [DirectedLight(direction=(0, 0, 1), rgb=one) for one in given]

    assert likely_orders(said, bright) == expected


def test_two_colours_are_of_two_lamps() -> None:
    """Also where both are most like the same one."""
    said = [DirectedLight(direction=(0, 0, 1), rgb=one) for one in (WARM, (1.0, 0.7, 0.3))]

    assert likely_orders(said, np.array([COOL, WARM])) in ([(1, 0)], [(0, 1)])
    assert likely_orders(said, np.array([(1.0, 0.8, 0.4), WARM])) == [(1, 0)]

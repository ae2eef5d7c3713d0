from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.errors import OptionError, UnusablePairError
from pipeline.images.frames import Mask
from pipeline.lamps.lamps import Lamps
from pipeline.lamps.shining import shining_warning, without_shining
from pipeline.options import LampCount
from pipeline.pair.reduced import ReducedPair
from tests.reduced_pairs import HEIGHT, WIDTH, even, reduced_pair

Build = Callable[..., Any]

FLASH = np.array([0.5, 0.4, 0.3])
LAMP = np.diag([1.0, 0.6, 0.3])
SCREEN = (slice(10, 24), slice(20, 50))
GLASS = 0.1  # of what walls reflect
BLUE = np.array([0.02, 0.1, 0.5])


@pytest.fixture
def room() -> Callable[..., ReducedPair]:
    """An even wall under one lamp, and on it a place of dark glass that shines."""

    def build(
        shines: Floats64 = BLUE, place: Any = SCREEN, glass: float | Floats64 = GLASS, **more: Any
    ) -> ReducedPair:
        light, flash = even(*(LAMP @ FLASH)), even(*FLASH)
        light[place], flash[place] = glass * light[place] + shines, glass * flash[place]
        return reduced_pair(light, flash, flash_only=True, **more)

    return build


@pytest.fixture
def lamps(lamps_of: Build, warm_to_cool: Floats64) -> Lamps:
    """The lamp on the wall."""
    found: Lamps = lamps_of(warm_to_cool[:1], matrices=LAMP[None])
    return found


def rest_of(reduced: ReducedPair, lamps: Lamps, of_rest: Lamps | None = None) -> Mask | None:
    """What shines itself where these lamps are found in all, and the others in the rest."""
    found = without_shining(reduced, lamps, lambda *_: of_rest or lamps)
    return None if found is None else found.shining


def test_a_screen_is_left_out_and_the_lamps_are_those_of_the_rest(
    room: Callable[..., ReducedPair], lamps: Lamps, lamps_of: Build, warm_to_cool: Floats64
) -> None:
    """The lamps of the whole pair were dragged towards the screen and leave some of it."""
    reduced, asked = room(), []
    dragged = lamps_of(warm_to_cool[:1], matrices=np.diag([0.7, 0.6, 0.5])[None])

    def estimate(rest: ReducedPair, number: LampCount) -> Lamps:
        asked.append((rest, number))
        return lamps

    found = without_shining(reduced, replace(dragged, requested=1), estimate)

    assert found is not None
    assert found.lamps is lamps
    assert asked == [(found.reduced, 1)]
    assert found.shining[SCREEN].all()
    assert found.shining.sum() == 16 * 32  # with its rim
    np.testing.assert_array_equal(found.reduced.usable, ~found.shining)


@pytest.mark.parametrize(
    "part", [(slice(4, 9), slice(5, 9)), (slice(3, 14), slice(8, 22))], ids=["hole", "bay"]
)
def test_dark_parts_of_its_picture_belong_to_a_screen(
    room: Callable[..., ReducedPair], lamps: Lamps, part: tuple[slice, slice]
) -> None:
    dark = np.zeros((14, 30, 3)) + BLUE
    dark[part] = 0.0

    shining = rest_of(room(dark), lamps)

    assert shining is not None
    assert shining[SCREEN].all()


def test_a_screen_of_which_a_corner_is_hidden_reaches_to_the_line_between_its_ends(
    room: Callable[..., ReducedPair], lamps: Lamps
) -> None:
    bright = np.zeros((30, 40, 3)) + BLUE
    bright[14:, 20:] = LAMP @ FLASH
    reduced = room(
        bright, (slice(5, 35), slice(20, 60)), glass=np.where(bright[..., :1] > 0.4, 0.5, GLASS)
    )

    shining = rest_of(reduced, lamps)

    assert shining is not None
    assert shining[20, 42]
    assert not shining[33, 58]


@pytest.mark.parametrize(("wide", "one"), [(8, True), (10, False)])
def test_a_gap_belongs_to_what_shines_on_both_sides_if_it_is_narrow(
    room: Callable[..., ReducedPair], lamps: Lamps, wide: int, one: bool
) -> None:
    gap = np.s_[:, 35 - wide // 2 : 35 + wide // 2]
    shines, glass = np.zeros((HEIGHT, WIDTH, 3)) + BLUE, np.full((HEIGHT, WIDTH, 1), GLASS)
    shines[gap], glass[gap] = 0.0, 1.0

    shining = rest_of(room(shines[SCREEN], glass=glass[SCREEN]), lamps)

    assert shining is not None
    assert shining[17, 35] == one


def light_of_blue(times: float, glass: float = GLASS) -> Floats64:
    """What dark glass must shine for its light by the flash's to be so many times a wall's."""
    wall = float((LAMP @ FLASH).sum())
    return (times - 1) * glass * wall / float(BLUE.sum()) * BLUE


@pytest.mark.parametrize(
    ("times", "glass", "left_out"),
    [
        (2.8, 0.2, False),
        (3.2, 0.2, True),
        (8.0, 0.28, True),
        (8.0, 0.32, False),
        (8.0, 0.9, False),
    ],
)
def test_what_shines_is_dim_by_the_flash_and_bright_beside_it(
    room: Callable[..., ReducedPair], lamps: Lamps, times: float, glass: float, left_out: bool
) -> None:
    reduced = room(light_of_blue(times, glass), glass=glass)

    assert (rest_of(reduced, lamps) is not None) == left_out


@pytest.mark.parametrize(("times", "left_out"), [(8.0, True), (2.8, False)])
def test_a_place_is_told_by_what_can_be_used(
    room: Callable[..., ReducedPair], lamps: Lamps, times: float, left_out: bool
) -> None:
    """Most of the picture cannot, and is dark; the place is 2 % of all and 6 % of the rest."""
    usable = np.zeros((HEIGHT, WIDTH), bool)
    usable[5:28, :54] = True
    place = slice(10, 17), slice(20, 30)
    reduced = room(light_of_blue(times), place, usable=usable)
    reduced.flash[~usable] /= 1000

    assert (rest_of(reduced, lamps) is not None) == left_out


@pytest.mark.parametrize(
    ("place", "left_out"),
    [((slice(10, 17), slice(20, 32)), False), ((slice(10, 20), slice(20, 31)), True)],
)
def test_less_than_three_percent_of_the_picture_may_be_noise(
    room: Callable[..., ReducedPair], lamps: Lamps, place: Any, left_out: bool
) -> None:
    assert (rest_of(room(place=place), lamps) is not None) == left_out


@pytest.mark.parametrize(
    ("blue", "by_all", "by_rest"),
    [(0.0065, False, False), (0.0085, True, False), (0.0115, True, True)],
)
def test_a_place_shines_by_light_that_neither_lamps_leave(
    room: Callable[..., ReducedPair], lamps: Lamps, blue: float, by_all: bool, by_rest: bool
) -> None:
    """.05 of it by all lamps, .07 by those of the rest."""
    reduced, asked = room(0.4 * LAMP @ FLASH + np.array([0.0, 0.0, blue])), []

    def estimate(rest: ReducedPair, _: LampCount) -> Lamps:
        asked.append(rest)
        return lamps

    found = without_shining(reduced, lamps, estimate)

    assert (len(asked), found is not None) == (by_all, by_rest)


@pytest.mark.parametrize(
    "otherwise",
    [
        {"shines": np.zeros(3)},  # a dark thing
        {"shines": 5 * LAMP @ FLASH},  # far off, under the same lamp
        {"glass": 0.5},  # answers the flash
        {"shines": BLUE / 20},  # hardly shines
        {"place": (slice(10, 17), slice(20, 30))},  # a fiftieth of the picture
        {"place": (slice(0, 40, 4), slice(None))},  # lines
        {"place": (slice(0, 25), slice(None))},  # most of the picture
        {"usable": np.zeros((HEIGHT, WIDTH), bool)},
    ],
)
def test_nothing_is_left_out_of_others(
    room: Callable[..., ReducedPair], lamps: Lamps, otherwise: dict[str, Any]
) -> None:
    assert rest_of(room(**otherwise), lamps) is None


def test_a_place_that_its_own_lamp_explains_does_not_shine(
    room: Callable[..., ReducedPair], lamps: Lamps, lamps_of: Build, warm_to_cool: Floats64
) -> None:
    """Of all lamps one lights that place alone: those of the rest do not have it."""
    own = np.diag([0.3, 0.6, 1.0])
    both = lamps_of(warm_to_cool[[0, 2]], matrices=np.stack([LAMP, own]))

    assert rest_of(room(own @ FLASH), both, lamps) is None


def test_the_rest_may_explain_a_place_that_wrong_lamps_did_not(
    room: Callable[..., ReducedPair], lamps: Lamps, lamps_of: Build, warm_to_cool: Floats64
) -> None:
    wrong = lamps_of(warm_to_cool[:1], matrices=np.diag([0.7, 0.6, 0.5])[None])

    assert rest_of(room(LAMP @ FLASH), wrong, lamps) is None


@pytest.mark.parametrize(("blue", "left_out"), [(0.02, False), (0.027, True)])
def test_more_must_be_left_over_of_a_rendering(
    room: Callable[..., ReducedPair], lamps: Lamps, blue: float, left_out: bool
) -> None:
    """Which bends light: what is left of it by less blue than that tells of a screen elsewhere."""
    reduced = room(0.4 * LAMP @ FLASH + np.array([0.0, 0.0, blue]))

    assert rest_of(reduced, lamps) is not None
    assert (rest_of(replace(reduced, rendered=True), lamps) is not None) == left_out


@pytest.mark.parametrize("problem", [UnusablePairError("too little"), OptionError("forbidden")])
def test_where_the_rest_tells_no_lamps_nothing_is_left_out(
    room: Callable[..., ReducedPair], lamps: Lamps, problem: Exception
) -> None:
    def refuse(*_: object) -> Lamps:
        raise problem

    assert without_shining(room(), lamps, refuse) is None


def test_the_warning_says_where_and_what_to_do() -> None:
    warning = shining_warning(0.123)

    assert warning.code == "shines_itself"
    assert warning.figures == {"share": 0.123}
    assert "In 12.3% of the picture" in warning.message
    assert "Switch it off" in warning.message

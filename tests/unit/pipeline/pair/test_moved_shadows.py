from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest

from pipeline.arrays import Floats32
from pipeline.pair.moved_shadows import (
    MovedShadows,
    _integrated,
    find_moved_shadows,
    moved_shadows_warning,
)
from pipeline.pair.reduced import ReducedPair
from pipeline.run_warnings import Code

HEIGHT, WIDTH = 96, 128
_PATCH = 32
_LAMPS = ((0.9, 0.3, 0.05), (0.15, 0.3, 0.5))
_FIRST = (slice(40, 80), slice(10, 50))  # rows and columns of a shadow of the first lamp


def paint(height: int = HEIGHT, width: int = WIDTH, patch: int = _PATCH) -> Floats32:
    drawn = np.random.default_rng(5).uniform(0.3, 0.9, (-(-height // patch), -(-width // patch), 3))
    whole = drawn.repeat(patch, axis=0).repeat(patch, axis=1)
    return np.asarray(whole[:height, :width], np.float32)


def light(
    surface: Floats32, shadow: tuple[slice, slice] | None, soft: float = 0.0, depth: float = 1.0
) -> Floats32:
    """Both lamps on a surface, the first without what a shadow takes of it."""
    lit = np.ones(surface.shape[:2], np.float32)
    if shadow is not None:
        lit[shadow] = 1.0 - depth
    if soft:
        lit = np.asarray(cv2.GaussianBlur(lit, (0, 0), soft), np.float32)
    first, second = np.array(_LAMPS, np.float32)
    return np.asarray(surface * (lit[..., None] * first + second), np.float32)


def pair(
    before: tuple[slice, slice] | None,
    after: tuple[slice, slice] | None,
    noise: float = 0.0,
    surface: Floats32 | None = None,
    rendered: bool = False,
    flash_only: bool = False,
    flash: float = 1.1,
    **how: Any,
) -> ReducedPair:
    """A shadow that falls here in the photograph without the flash and there in the other."""
    surface = paint() if surface is None else surface
    random = np.random.default_rng(1)
    no_flash = light(surface, before, **how)
    part = flash * surface + light(surface, after, **how) - no_flash
    no_flash, part = (
        (image + noise * random.standard_normal(image.shape)).astype(np.float32)
        for image in (no_flash, part)
    )
    variance = np.full_like(part, max(noise, 1e-4) ** 2)
    usable = np.asarray(np.minimum(part, no_flash).min(axis=2) > 0.01)
    return ReducedPair(
        no_flash, part, variance, variance, usable, 1, rendered, flash_only=flash_only
    )


def shadows(scene: ReducedPair, something_moved: bool = True) -> MovedShadows:
    found = find_moved_shadows(scene, something_moved)
    assert found is not None
    return found


@pytest.mark.parametrize("noise", [0.0, 0.01])
@pytest.mark.parametrize("shadow", [None, _FIRST])
def test_a_still_pair_loses_next_to_nothing(
    noise: float, shadow: tuple[slice, slice] | None
) -> None:
    scene = pair(shadow, shadow, noise)

    assert find_moved_shadows(scene, False) is None
    assert shadows(scene).share < 0.01
    assert not shadows(scene).surely.any()
    assert shadows(scene).places.mean() < 0.1  # corners where rims of paint and of a shadow meet


@pytest.mark.parametrize("something_moved", [False, True])
@pytest.mark.parametrize("noise", [0.0, 0.01])
@pytest.mark.parametrize("soft", [0.0, 2.0, 4.0])
@pytest.mark.parametrize(("before", "after"), [(_FIRST, None), (None, _FIRST)])
def test_a_shadow_that_went_or_came_is_found_between_its_edges(
    before: tuple[slice, slice] | None,
    after: tuple[slice, slice] | None,
    soft: float,
    noise: float,
    something_moved: bool,
) -> None:
    found = shadows(pair(before, after, noise, soft=soft), something_moved)

    assert found.places[_FIRST].mean() > 0.9
    assert found.surely[_FIRST].mean() > 0.5
    assert not (found.surely & ~found.places).any()
    assert found.share > 0.05
    far = np.ones((HEIGHT, WIDTH), bool)
    far[20:, :75] = False
    assert found.places[far].mean() < 0.02


def test_a_shadow_that_moved_on_is_found_where_it_was_and_where_it_is() -> None:
    here, there = (slice(40, 80), slice(8, 24)), (slice(40, 80), slice(42, 54))

    found = shadows(pair(here, there))

    assert found.places[here].mean() > 0.9
    assert found.places[there].mean() > 0.9
    for place in (here, there):
        assert found.surely[place].mean() > 0.8


@pytest.mark.parametrize(
    ("depth", "marked", "told"),
    [(0.05, False, False), (0.4, True, False), (0.8, True, True)],
)
def test_the_fainter_a_shadow_is_the_less_is_told(depth: float, marked: bool, told: bool) -> None:
    scene = pair(_FIRST, None, depth=depth)

    assert shadows(scene).places.any() == marked
    assert shadows(scene).surely.any() == told
    assert (find_moved_shadows(scene, False) is not None) == told


def test_shadows_in_noise_are_not_found() -> None:
    scene = pair(_FIRST, None, 0.2, depth=0.3)

    assert shadows(scene).share < 0.01


def test_a_speck_is_chance() -> None:
    speck = slice(40, 41), slice(40, 41)

    found = shadows(pair(None, speck, surface=np.full((64, 64, 3), 0.5, np.float32)))

    assert not found.places[:30].any()
    assert found.share < 0.01


@pytest.mark.parametrize("size", [(300, 420), (301, 423)])
def test_large_pairs_are_looked_at_in_larger_blocks(size: tuple[int, int]) -> None:
    place = slice(90, 190), slice(60, 190)

    found = shadows(pair(place, None, surface=paint(*size, patch=100)))

    assert found.places.shape == size
    assert found.places[place].mean() > 0.9
    assert found.places[:60].mean() < 0.05
    assert found.share > 0.05


def test_unusable_blocks_tell_of_nothing() -> None:
    scene = pair(_FIRST, None)
    scene.usable[30:90, :60] = False
    scene.flash[~scene.usable] = -1.0

    found = shadows(scene)

    assert not found.places.any()
    assert found.share == 0.0


def test_nothing_usable_has_nothing_found() -> None:
    scene = pair(_FIRST, None)
    scene.usable[:] = False

    assert find_moved_shadows(scene, True) is None


@pytest.mark.parametrize(("rendered", "flash_only"), [(True, False), (False, True)])
@pytest.mark.parametrize("something_moved", [False, True])
def test_renderings_and_flash_parts_given_alone_are_not_looked_at(
    rendered: bool, flash_only: bool, something_moved: bool
) -> None:
    scene = pair(_FIRST, None, rendered=rendered, flash_only=flash_only)

    assert find_moved_shadows(scene, something_moved) is None


def test_lamps_are_told_by_everything_where_next_to_nothing_would_be_left() -> None:
    scene = pair(None, None, surface=paint(patch=8))
    scene.flash[:] = paint(HEIGHT + 3, WIDTH + 5, 8)[3:, 5:]

    assert find_moved_shadows(scene, True) is None


@pytest.mark.parametrize("size", [(40, 60), (41, 61)])
def test_steps_are_integrated_and_forgotten_far_away(size: tuple[int, int]) -> None:
    height, width = size
    steps = np.zeros((height, width, 2), np.float32)
    steps[:, 29:31, 0] = 0.5  # one step of 1 in the middle, over two blocks

    field = _integrated(steps)

    assert field.shape == size
    assert field[20, 31] - field[20, 28] == pytest.approx(1.0, abs=0.1)
    assert field[20, 29] + field[20, 30] == pytest.approx(0.0, abs=0.05)
    assert abs(field[20, -1]) < field[20, 32]


def test_the_warning_says_what_to_do() -> None:
    told = moved_shadows_warning(0.123)

    assert told.code is Code.MOVED
    assert told.figures == {"share": 0.123}
    assert told.message.startswith("In 12.3% of the picture light of the lamps is in what the")

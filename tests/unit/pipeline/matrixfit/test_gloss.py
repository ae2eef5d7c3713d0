from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.light.model import Model
from pipeline.matrixfit.gloss import is_gloss
from pipeline.pair.reduced import ReducedPair, reduce_pair

Seen = Callable[..., ReducedPair]


@pytest.fixture
def lamps(model: Model, warm_to_cool: Floats64) -> Floats64:
    matrices = model.lamp_matrix(warm_to_cool[[0, 2]])
    return np.asarray(matrices / np.linalg.norm(matrices, axis=(1, 2), keepdims=True))


@pytest.fixture
def seen(
    pair_of: Callable[..., Any],
    flash_part: Floats64,
    shares_of: Callable[[int], Floats64],
    model: Model,
) -> Seen:
    """Light of lamps, some of it mirrored, and some of the flash's beside it."""

    def of(
        matrices: Floats64, gloss: float, of_flash: float = 0.0, noise: float = 0.0
    ) -> ReducedPair:
        height, width = flash_part.shape[:2]
        shine = np.zeros((height, width, 1))
        shine[::4, ::4] = gloss
        flash = flash_part.astype(float)
        z = 0.4 + shares_of(2)[: len(matrices)]
        light = np.einsum("nhw,nkl,hwl->hwk", z, matrices, flash)
        light += shine * (matrices[0] @ model.flash_white)
        flash[2::4, 2::4] += of_flash * model.flash_white
        if noise:
            random = np.random.default_rng(5)
            one, other = random.normal(0, noise, (2, *light.shape))
            light += one
            flash += other - one
        reduced = reduce_pair(pair_of(light, flash))
        variance = np.full_like(reduced.no_flash, noise**2)
        return replace(reduced, no_flash_variance=variance, flash_variance=2 * variance)

    return of


@pytest.mark.parametrize("gloss", [0.02, 0.1])
@pytest.mark.parametrize("of_flash", [0.0, 0.05])
@pytest.mark.parametrize("noise", [0.0, 0.003, 0.014])
def test_mirrored_light_of_one_lamp_is_gloss(
    seen: Seen, lamps: Floats64, model: Model, gloss: float, of_flash: float, noise: float
) -> None:
    reduced = seen(lamps[:1], gloss, of_flash, noise)

    assert is_gloss(reduced, lamps[:1], lamps, model.flash_white)


@pytest.mark.parametrize("noise", [0.0, 0.003])
@pytest.mark.parametrize("gloss", [0.0, 0.02])
def test_light_of_two_lamps_is_none(
    seen: Seen, lamps: Floats64, model: Model, noise: float, gloss: float
) -> None:
    reduced = seen(lamps, gloss, 0.0, noise)
    mean = lamps.mean(axis=0, keepdims=True)

    for one in (lamps[:1], lamps[1:], mean):
        assert not is_gloss(reduced, one, lamps, model.flash_white)


@pytest.mark.parametrize(("aside", "gloss"), [(0.002, True), (0.009, False)])
def test_gloss_leaves_no_more_than_a_second_lamp(
    pair_of: Callable[..., Any],
    flash_part: Floats64,
    lamps: Floats64,
    model: Model,
    aside: float,
    gloss: bool,
) -> None:
    """On one surface a second lamp gives nearly what the first would by gloss, and some aside.

    aside: its part of the light there. Gloss explains more than nine tenths of the second lamp.
    """
    surface = np.array([0.5, 0.3, 0.1])
    flash = np.broadcast_to(surface, flash_part.shape)
    matt, mirrored = lamps[0] @ surface, lamps[0] @ model.flash_white
    normal = np.cross(matt, mirrored)
    normal *= np.linalg.norm(matt) / np.linalg.norm(normal)
    given = 0.2 * np.linalg.norm(matt) / np.linalg.norm(mirrored) * mirrored + aside * normal
    second = np.outer(given, surface) / (surface @ surface)
    half = np.arange(flash.shape[1])[None, :, None] < flash.shape[1] // 2
    pair = pair_of(np.where(half, matt, matt + given), flash)

    found = is_gloss(reduce_pair(pair), lamps[:1], np.stack([lamps[0], second]), model.flash_white)

    assert found is gloss


def test_what_gloss_leaves_over_is_no_gloss(seen: Seen, lamps: Floats64, model: Model) -> None:
    """Two lamps neither of which is there explain nothing better."""
    reduced = seen(lamps, 0.0)
    wrong = np.stack([lamps[0], lamps[0]])

    assert not is_gloss(reduced, lamps[:1], wrong, model.flash_white)


def test_the_strength_of_the_flash_on_white_tells_nothing(
    seen: Seen, lamps: Floats64, model: Model
) -> None:
    reduced = seen(lamps[:1], 0.1)

    assert is_gloss(reduced, lamps[:1], lamps, 7.0 * model.flash_white)
    assert not is_gloss(reduced, lamps[:1], lamps, model.flash_white * [1.0, 0.5, 1.0])


@pytest.mark.parametrize(("every", "gloss"), [(4, True), (3, False)])
def test_few_pixels_that_are_far_off_tell_nothing(
    seen: Seen, lamps: Floats64, model: Model, every: int, gloss: bool
) -> None:
    """Each counts 0.0025 at most: of a 16th of the light less than 2e-4, of a ninth more."""
    reduced = seen(lamps[:1], 0.1)
    odd = reduced.no_flash.copy()
    odd[1::every, 1::every] *= np.array([0.5, 2.0, 0.5], np.float32)

    found = is_gloss(replace(reduced, no_flash=odd), lamps[:1], lamps, model.flash_white)

    assert found is gloss

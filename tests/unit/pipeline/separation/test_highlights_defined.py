"""Highlights beside their definition, on pixels of any kind."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest

from pipeline.arrays import Floats32, Floats64
from pipeline.images.frames import by_planes
from pipeline.lamps.lamps import Lamps
from pipeline.light.model import Model
from pipeline.matrixfit.deviations import TERMS, Deviations
from pipeline.pair.reduced import ReducedPair
from pipeline.separation.find_highlights import find_highlights
from pipeline.separation.highlights import Highlights
from tests.definitions import highlights as definition
from tests.reduced_pairs import reduced_pair


@pytest.fixture
def spotted(
    lamps_of: Callable[..., Lamps], model: Model, surfaces: Floats64, warm_to_cool: Floats64
) -> Callable[..., tuple[ReducedPair, Lamps]]:
    """Make patches of any paint, with noise, dead blocks and spots that mirror anything."""

    def build(seed: int) -> tuple[ReducedPair, Lamps]:
        rng = np.random.default_rng(seed)
        chosen, white = warm_to_cool[[0, 2]], model.flash_white
        matrices = model.lamp_matrix(chosen)
        paints = surfaces[rng.integers(0, len(surfaces), (2, 4))]
        paints = paints.repeat(32, axis=0).repeat(32, axis=1)[:64, :100]
        v, u = np.mgrid[:64, :100]
        flash = paints * (0.8 - ((u / 100 - 0.5) ** 2 + (v / 64 - 0.5) ** 2))[..., None]
        shares = np.stack([0.7 - u / 160, 0.02 + u / 130])
        shares[:, np.hypot(u - 50, v - 20) < 12] *= rng.uniform(0, 1, (2, 1))
        light = np.einsum("nhw,nkl,hwl->hwk", shares, matrices, flash)
        for kind in rng.permutation(np.arange(12) % 3):
            disc = np.hypot(u - rng.uniform(0, 100), v - rng.uniform(0, 64)) < rng.uniform(3, 6)
            gloss = disc[..., None] * rng.choice([0.02, 0.06, 0.2])
            if kind < 2:
                light += gloss * (matrices[kind] @ white)
            else:
                flash += 0.3 * gloss * white
        noise = rng.choice([0.001, 0.003, 0.01])  # without any, shares lie in the middle by pairs
        light *= 1 + noise * rng.normal(size=light.shape)
        flash *= 1 + noise * rng.normal(size=light.shape)
        light[:3], flash[2:5], flash[:, :3] = 0, 0, -0.001
        usable = rng.random((64, 100)) > 0.03
        lamps = lamps_of(
            chosen, channel_weights=1 / light.mean(axis=(0, 1)), deviations=deviating(rng)
        )
        variances = {
            "no_flash_variance": np.square(noise * light).astype(np.float32),
            "flash_variance": np.square(noise * flash).astype(np.float32),
        }
        images = light.astype(np.float32), flash.astype(np.float32)
        return reduced_pair(*images, usable=usable & (flash > 0).all(axis=2), **variances), lamps

    return build


@pytest.mark.parametrize("seed", [0, 1, 4, 5])
def test_what_is_found_is_what_it_is_defined_to_be(
    spotted: Callable[..., tuple[ReducedPair, Lamps]], model: Model, seed: int
) -> None:
    """But for a few blocks, where rounding decides which neighbour is in the middle."""
    reduced, lamps = spotted(seed)

    found = find_highlights(reduced, lamps, model.flash_white)
    defined = definition.find_highlights(reduced, lamps, model.flash_white)

    assert found is not None
    assert defined is not None
    marked = found.blocks[..., :3].any(axis=2)
    assert 100 < marked.sum() < 3000
    other = (found.blocks[..., :3] != defined.blocks[..., :3]).any(axis=2)
    unlike = np.abs(found.blocks[..., 3:] - defined.blocks[..., 3:]) > 1e-4
    assert other.sum() <= 2
    assert unlike.any(axis=2).sum() <= 20
    assert np.isfinite(found.blocks).all()
    np.testing.assert_array_equal(found.colours, defined.colours)
    assert (found.side, defined.side) == (reduced.block, reduced.block)


@dataclass(frozen=True)
class Blend:
    """Pixels of anything in highlights of anything, and proportions of matt light there."""

    highlights: Highlights
    no_flash: Floats32
    flash: Floats32
    lamps: Lamps
    proportions: Floats32

    def dealt(self) -> Floats32:
        """What deal_out makes of them."""
        rows = slice(0, len(self.flash))
        return self.highlights.deal_out(
            rows, self.no_flash, self.flash, self.lamps, self.proportions.copy()
        )


@pytest.fixture
def blend(
    lamps_of: Callable[..., Lamps], model: Model, warm_to_cool: Floats64
) -> Callable[..., Blend]:
    """Make blocks of every kind side by side, one in three of none, three pixels across."""

    def build(seed: int) -> Blend:
        rng = np.random.default_rng(seed)
        kinds = np.eye(4, dtype=np.float32)[rng.integers(0, 4, (8, 12))][..., :3]
        blocks = np.concatenate([kinds, rng.uniform(0, 1, (8, 12, 2))], axis=2)
        no_flash, flash = rng.uniform(-0.02, 0.6, (2, 25, 37, 3)).astype(np.float32)
        no_flash[:3], flash[2:5] = 0, 0
        own = rng.uniform(0, 1, (25, 37, 3)).astype(np.float32)
        lamps = lamps_of(
            warm_to_cool[[0, 2]],
            channel_weights=rng.uniform(0.5, 4, 3),
            deviations=deviating(rng),
        )
        colours = lamps.matrices @ model.flash_white
        highlights = Highlights(blocks.astype(np.float32), 3, colours)
        return Blend(highlights, no_flash, flash, lamps, np.stack([own, 1 - own]))

    return build


def deviating(rng: np.random.Generator) -> Deviations:
    """Deviations of two lamps of a few thousandths."""
    terms = 0.002 * rng.normal(size=(2, 3, TERMS))
    return Deviations(np.array([0.35, 0.4]), np.array([0.06, 0.05]), terms)


@pytest.mark.parametrize("seed", range(4))
def test_what_is_dealt_out_is_what_it_is_defined_to_be(
    blend: Callable[..., Blend], seed: int
) -> None:
    given = blend(seed)

    found = given.dealt()

    defined = definition.deal_out(
        given.highlights, given.no_flash, given.flash, given.lamps, given.proportions
    )
    np.testing.assert_allclose(found, defined, atol=3e-5)
    assert (np.abs(found - given.proportions) > 0.01).mean() > 0.3
    assert np.isfinite(found).all()
    assert found.min() >= -1e-6
    assert found.max() <= 1 + 1e-6
    np.testing.assert_allclose(found.sum(axis=0), 1, atol=1e-6)


def test_proportions_are_dealt_out_however_they_lie_in_memory(blend: Callable[..., Blend]) -> None:
    given = blend(1)
    laid = by_planes(*given.proportions.shape)
    laid[...] = given.proportions

    found = given.highlights.deal_out(slice(0, 25), given.no_flash, given.flash, given.lamps, laid)

    np.testing.assert_array_equal(found, given.dealt())
    np.testing.assert_array_equal(found, laid)


def test_lamps_in_the_other_order_have_the_same_light(blend: Callable[..., Blend]) -> None:
    """Between highlights of two kinds, too: there are many."""
    given = blend(2)
    lamps, deviations = given.lamps, given.lamps.deviations
    turned = replace(
        given,
        highlights=replace(
            given.highlights,
            blocks=np.ascontiguousarray(given.highlights.blocks[..., [1, 0, 2, 4, 3]]),
            colours=given.highlights.colours[::-1],
        ),
        lamps=replace(
            lamps,
            matrices=lamps.matrices[::-1],
            deviations=replace(deviations, terms=deviations.terms[::-1]),
        ),
        proportions=np.ascontiguousarray(given.proportions[::-1]),
    )

    np.testing.assert_allclose(turned.dealt()[::-1], given.dealt(), atol=3e-5)

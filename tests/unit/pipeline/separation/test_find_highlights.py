from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.images.noise import Noise
from pipeline.lamps.lamps import Lamps
from pipeline.light.model import Model
from pipeline.pair.pair import Pair
from pipeline.pair.reduced import reduce_pair
from pipeline.separation.find_highlights import find_highlights
from tests.unit.pipeline.separation.glossy import (
    LOUD,
    SIZE,
    Scene,
    balanced,
    noisy,
)


@pytest.mark.parametrize(("noise", "near"), [(None, 0.05), (LOUD, 0.15)], ids=["exact", "noisy"])
@pytest.mark.parametrize(("gloss", "of_flash"), [(0.1, 0.03), (0.3, 0.05)])
def test_each_highlight_is_found_and_nothing_else(
    scene: Callable[..., Scene],
    model: Model,
    noise: Noise | None,
    near: float,
    gloss: float,
    of_flash: float,
) -> None:
    glossy = scene(gloss, of_flash, noise=noise)

    found = find_highlights(glossy.reduced, glossy.lamps, model.flash_white)

    assert found is not None
    assert found.side == 1
    np.testing.assert_allclose(found.colours, glossy.lamps.matrices @ model.flash_white)
    marked = np.moveaxis(found.blocks[..., :3], 2, 0)
    assert set(np.unique(marked)) == {0.0, 1.0}
    assert not marked[~glossy.mirrors].any()
    for mirror, mark in zip(glossy.mirrors, marked, strict=True):
        assert mark.sum() > 0.6 * mirror.sum()
    down, across = np.nonzero(marked.any(axis=0))
    true = [0.6 - 0.4 * across / SIZE[1], 0.2 + 0.4 * across / SIZE[1]]
    np.testing.assert_allclose(found.blocks[down, across, 3:].T, true, atol=near)


@pytest.mark.parametrize("noise", [None, LOUD], ids=["exact", "noisy"])
@pytest.mark.parametrize("kind", ["exact", "shadowed"])
def test_matt_surfaces_have_no_highlights(
    exact: Callable[..., tuple[Pair, Floats64]],
    shadowed: Callable[[Floats64], Pair],
    pair_of: Callable[..., Pair],
    lamps_of: Callable[..., Lamps],
    model: Model,
    warm_to_cool: Floats64,
    kind: str,
    noise: Noise | None,
) -> None:
    """Patches of many colours, in soft light or with hard edges of shadows."""
    chosen = warm_to_cool[[0, 2]]
    clean = exact(chosen)[0] if kind == "exact" else shadowed(chosen)
    light = np.asarray(clean.no_flash, np.float64)
    pair = noisy(light, clean.flash - light, noise, pair_of)
    lamps = lamps_of(chosen, **balanced(light))

    assert find_highlights(reduce_pair(pair), lamps, model.flash_white) is None


@pytest.mark.parametrize(("across", "told"), [(6, False), (16, True)])
def test_a_colour_that_nothing_around_has_tells_no_highlight(
    model: Model,
    paints: Floats64,
    pair_of: Callable[..., Pair],
    lamps_of: Callable[..., Lamps],
    warm_to_cool: Floats64,
    across: int,
    told: bool,
) -> None:
    """A square of another paint, all of it mirroring a lamp: blocks six apart are compared."""
    matrices = model.lamp_matrix(warm_to_cool[[0, 2]])
    square = slice(100, 100 + across), slice(200, 200 + across)
    flash = np.tile(0.7 * paints[0], (320, 480, 1))
    flash[square] = 0.7 * paints[5]
    light = np.einsum("kl,hwl->hwk", 0.4 * matrices[0] + 0.3 * matrices[1], flash)
    light[square] += 0.1 * matrices[0] @ model.flash_white
    lamps = lamps_of(warm_to_cool[[0, 2]], **balanced(light))

    found = find_highlights(reduce_pair(pair_of(light, flash)), lamps, model.flash_white)

    assert (found is not None) == told


@pytest.mark.parametrize("chosen", [[0], [0, 1, 2]], ids=["one lamp", "three lamps"])
def test_of_another_number_of_lamps_no_highlights_are_found(
    scene: Callable[..., Scene],
    model: Model,
    lamps_of: Callable[..., Lamps],
    warm_to_cool: Floats64,
    chosen: list[int],
) -> None:
    lamps = lamps_of(warm_to_cool[chosen])

    assert find_highlights(scene().reduced, lamps, model.flash_white) is None

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pipeline.arrays import Floats32, Floats64
from pipeline.images.noise import Noise
from pipeline.lamps.lamps import Lamps
from pipeline.light.model import Model
from pipeline.options import Options
from pipeline.pair.pair import Pair
from pipeline.progress import Progress
from pipeline.separation import separation
from pipeline.separation.find_highlights import find_highlights
from pipeline.separation.separation import separate
from pipeline.spectra.cameras import Camera
from pipeline.spectra.lights import find_light, reflectance_spectra
from pipeline.spectra.matrices import best_matrix
from tests.definitions.highlights import deal_out
from tests.definitions.separation import separate as defined_separate
from tests.unit.pipeline.separation.glossy import (
    LOUD,
    RADIUS,
    SIZE,
    Scene,
    balanced,
    discs,
    noisy,
    off,
)


@pytest.mark.parametrize(
    ("gloss", "of_flash", "errors", "matt_errors"),
    [
        (0.1, 0.03, (0.013, 0.019, 0.029), (1.1, 0.56, 0.43)),
        (0.3, 0.05, (0.007, 0.008, 0.007), (1.4, 0.22, 0.46)),
    ],
)
def test_highlights_are_dealt_out_to_what_is_mirrored(
    scene: Callable[..., Scene],
    model: Model,
    layers_by: Callable[..., Floats32],
    gloss: float,
    of_flash: float,
    errors: tuple[float, ...],
    matt_errors: tuple[float, ...],
) -> None:
    """Where they are marked, within 3 %; in proportions of matt light 22 to 140 % off."""
    glossy = scene(gloss, of_flash)
    found = find_highlights(glossy.reduced, glossy.lamps, model.flash_white)
    assert found is not None

    with_them, matt = layers_by(glossy), layers_by(glossy, highlights=False)

    for kind, (most, least) in enumerate(zip(errors, matt_errors, strict=True)):
        marked = found.blocks[..., kind] > 0
        assert off(with_them, glossy, marked) < most
        assert off(matt, glossy, marked) > least
    elsewhere = ~found.blocks[..., :3].any(axis=2)
    np.testing.assert_array_equal(with_them[:, elsewhere], matt[:, elsewhere])
    assert off(with_them, glossy, np.logical_not(glossy.mirrors.any(axis=0))) < 1e-6
    np.testing.assert_allclose(with_them.sum(axis=0), glossy.pair.no_flash, rtol=3e-6)


def test_highlights_in_noise_are_dealt_out_nearly_as_well(
    scene: Callable[..., Scene], model: Model, layers_by: Callable[..., Floats32]
) -> None:
    glossy = scene(noise=LOUD)
    found = find_highlights(glossy.reduced, glossy.lamps, model.flash_white)
    assert found is not None

    with_them, matt = layers_by(glossy), layers_by(glossy, highlights=False)

    for kind, least in enumerate((1.0, 0.5, 0.4)):
        marked = found.blocks[..., kind] > 0
        assert off(with_them, glossy, marked) < 0.035
        assert off(matt, glossy, marked) > least


def test_highlights_of_large_pictures_are_found_by_blocks(
    scene: Callable[..., Scene], model: Model, layers_by: Callable[..., Floats32]
) -> None:
    """Blocks of two pixels, and a row and a column that belong to none."""
    glossy = scene(size=(483, 641))
    found = find_highlights(glossy.reduced, glossy.lamps, model.flash_white)
    assert found is not None
    assert found.side == 2
    assert found.blocks.shape == (241, 320, 5)

    with_them, matt = layers_by(glossy), layers_by(glossy, highlights=False)

    shrunk = np.moveaxis(found.blocks[..., :3] > 0, 2, 0)
    marked = np.pad(np.kron(shrunk, np.ones((2, 2), bool)), ((0, 0), (0, 1), (0, 1)))
    assert not (marked & ~discs((483, 641), RADIUS + 0.006)).any()
    cores = discs((483, 641), 0.8 * RADIUS)
    assert (marked | ~cores).all()
    for core, least in zip(cores, (1.1, 0.55, 0.43), strict=True):
        assert off(with_them, glossy, core) < 0.03
        assert off(matt, glossy, core) > least


@pytest.mark.parametrize("size", [SIZE, (110, 600)], ids=["pixels", "blocks"])
def test_highlights_do_not_depend_on_the_strips_by_a_bit(
    scene: Callable[..., Scene],
    layers_by: Callable[..., Floats32],
    size: tuple[int, int],
) -> None:
    glossy = scene(size=size)
    whole = layers_by(glossy)
    assert (whole != layers_by(glossy, highlights=False)).any()

    for rows in (1, 7, 32, 33, size[0] - 1):
        np.testing.assert_array_equal(layers_by(glossy, rows), whole)


def test_clipped_highlights_are_filled_in_from_the_surroundings(
    scene: Callable[..., Scene], layers_by: Callable[..., Floats32]
) -> None:
    clipped = discs(SIZE, RADIUS + 0.01).any(axis=0)
    glossy = scene(unusable=clipped)

    with_them, matt = layers_by(glossy), layers_by(glossy, highlights=False)

    np.testing.assert_array_equal(with_them, matt)
    light = glossy.pair.no_flash
    around = (with_them / light)[:, clipped]
    beside = (glossy.layers / glossy.layers.sum(axis=0))[:, ~glossy.mirrors.any(axis=0)]
    assert around[0].min() > beside[0].min() - 0.01
    assert around[0].max() < beside[0].max() + 0.01


def test_pixels_that_are_clipped_within_a_highlight_are_filled_in(
    scene: Callable[..., Scene], layers_by: Callable[..., Floats32]
) -> None:
    clipped = np.zeros(SIZE, bool)
    clipped[30, 40] = True

    glossy, whole = scene(unusable=clipped), scene()

    with_them, matt = layers_by(glossy), layers_by(glossy, highlights=False)
    near = np.zeros(SIZE, bool)
    near[29:32, 39:42] = True
    np.testing.assert_array_equal(with_them[:, near], matt[:, near])
    assert off(with_them, glossy, discs(SIZE, 0.5 * RADIUS)[0] & ~near) < 0.02
    assert off(layers_by(whole), whole, near) < 0.02


@pytest.mark.parametrize("noise", [None, LOUD], ids=["exact", "noisy"])
@pytest.mark.parametrize("first", [0, 100, 200])
def test_measured_paints_that_matrices_describe_nearly_are_hardly_changed(
    camera: Camera,
    model: Model,
    pair_of: Callable[..., Pair],
    lamps_of: Callable[..., Lamps],
    layers_by: Callable[..., Floats32],
    noise: Noise | None,
    first: int,
) -> None:
    """Light of whole spectra, on squares of the most saturated paints, of others, of greys.

    Some squares of one paint are taken for highlights, which does no harm: errors of 1.2 to 3 %
    grow by less than a hundredth of themselves.
    """
    lights = np.array([model.flash, find_light("A"), find_light("D150")])
    seen = camera.sensitivities * lights[:, None]
    seen /= seen[:, 1].sum(axis=1)[:, None, None]
    paints = reflectance_spectra() @ seen.transpose(0, 2, 1)
    colour = paints[0] / paints[0].sum(axis=1, keepdims=True)
    white = model.flash_white / model.flash_white.sum()
    order = np.argsort(-np.linalg.norm(colour - white, axis=1))[first:][:48].reshape(6, 8)
    flash, *lit = paints[:, order].repeat(20, axis=1).repeat(20, axis=2)
    across = (np.arange(SIZE[1]) / SIZE[1])[:, None]
    layers = np.array([(0.9 - 0.8 * across) * lit[0], (0.1 + 0.6 * across) * lit[1]])
    light = layers.sum(axis=0)
    matrices = np.array([best_matrix(seen[0], one) for one in seen[1:]])
    lamps = lamps_of(seen[1:].sum(axis=2), matrices=matrices, **balanced(light))
    matt = Scene(noisy(light, flash, noise, pair_of), lamps, layers, discs(SIZE))

    found = find_highlights(matt.reduced, lamps, model.flash_white)

    assert found is None or found.blocks[..., :3].sum() < 0.05 * SIZE[0] * SIZE[1]
    everywhere = np.ones(SIZE, bool)
    without = off(layers_by(matt, highlights=False), matt, everywhere)
    assert without < 0.03
    assert off(layers_by(matt), matt, everywhere) < 1.01 * without


def test_on_grey_a_highlight_is_the_light_of_its_lamp_as_it_is(
    scene: Callable[..., Scene], model: Model, layers_by: Callable[..., Floats32]
) -> None:
    grey = scene(paint=0.3 * model.flash_white)

    assert find_highlights(grey.reduced, grey.lamps, model.flash_white) is None
    assert off(layers_by(grey), grey, np.ones(SIZE, bool)) < 1e-3


@pytest.mark.parametrize("index", [24, 39, 59])
@pytest.mark.parametrize(("radius", "told"), [(0.025, True), (RADIUS, False)])
def test_a_highlight_that_paint_could_have_the_colour_of_is_told_by_its_brightness(
    scene: Callable[..., Scene],
    model: Model,
    layers_by: Callable[..., Floats32],
    paints: Floats64,
    index: int,
    radius: float,
    told: bool,
) -> None:
    """Both lamps together make the first one's white on these paints, out of shares around.

    Where the highlight is more than a seventh of what lies around, it is not brighter than that.
    """
    glossy = scene(0.3, 0.0, paint=paints[index], radius=radius)
    first = glossy.mirrors[0]

    found = find_highlights(glossy.reduced, glossy.lamps, model.flash_white)

    assert found is not None
    assert (found.blocks[..., 0] > 0)[first].mean() == told
    assert off(layers_by(glossy, highlights=False), glossy, first) > 0.5
    assert (off(layers_by(glossy), glossy, first) < 0.02) == told


def test_where_nothing_can_be_used_there_are_no_highlights(
    scene: Callable[..., Scene], model: Model, layers_by: Callable[..., Floats32]
) -> None:
    closed = scene(unusable=np.ones(SIZE, bool))

    assert find_highlights(closed.reduced, closed.lamps, model.flash_white) is None
    assert np.isfinite(layers_by(closed)).all()


@pytest.mark.parametrize("size", [(1, 1), (7, 3), (3, 7), (1, 9)])
def test_small_pictures_of_a_few_pixels_do_no_harm(
    pair_of: Callable[..., Pair],
    lamps_of: Callable[..., Lamps],
    layers_by: Callable[..., Floats32],
    warm_to_cool: Floats64,
    size: tuple[int, int],
) -> None:
    """All of it mirrored light, or whatever it may be."""
    rng = np.random.default_rng(5)
    for _ in range(20):
        light, flash = rng.uniform(0.01, 0.5, (2, *size, 3))
        tiny = Scene(pair_of(light, flash), lamps_of(warm_to_cool[[0, 2]]), light, light > 0)

        layers = layers_by(tiny)

        assert layers.min() >= 0
        np.testing.assert_allclose(layers.sum(axis=0), light, rtol=1e-5)


def test_black_pixels_stay_black(
    scene: Callable[..., Scene], model: Model, layers_by: Callable[..., Floats32]
) -> None:
    """One in a highlight, a row across another, and all that is left of a third."""
    glossy = scene()
    no_flash, flash = np.array(glossy.pair.no_flash[:]), np.array(glossy.pair.flash[:])
    for dark in ((30, 40), (30, slice(100, None))):
        no_flash[dark] = flash[dark] = 0
    flash[86] = no_flash[86]
    glossy = replace(
        glossy, pair=replace(glossy.pair, no_flash=no_flash, photograph=no_flash, flash=flash)
    )
    assert find_highlights(glossy.reduced, glossy.lamps, model.flash_white) is not None

    layers = layers_by(glossy)

    assert np.isfinite(layers).all()
    assert not layers[:, 30, 40].any()
    assert not layers[:, 30, 100:].any()
    np.testing.assert_allclose(layers.sum(axis=0), glossy.pair.no_flash, rtol=3e-6)


def test_the_published_method_asks_for_no_highlights(
    scene: Callable[..., Scene], model: Model, monkeypatch: pytest.MonkeyPatch
) -> None:
    glossy, asked = scene(), list[int]()
    monkeypatch.setattr(separation, "find_highlights", lambda *_: asked.append(1))

    for method, times in (("paper", 0), ("best", 1)):
        options = Options(method=method)  # type: ignore[arg-type]
        given = glossy.pair, glossy.reduced, glossy.lamps, model, options, Progress(), 1000
        assert len(list(separate(*given))) == 1
        assert len(asked) == times


@pytest.mark.parametrize("more", [{}, {"flash_only": True}, {"registration_px": 0.35}], ids=str)
def test_layers_with_highlights_are_what_they_are_defined_to_be(
    scene: Callable[..., Scene],
    model: Model,
    layers_by: Callable[..., Floats32],
    more: dict[str, Any],
) -> None:
    glossy = scene(noise=LOUD, **more)

    layers, _ = defined_separate(glossy.pair, glossy.reduced, glossy.lamps, model.flash_white)

    np.testing.assert_allclose(layers_by(glossy, 13), layers, atol=1e-5)
    assert np.abs(layers - layers_by(glossy, highlights=False)).max() > 0.01


@pytest.mark.parametrize("channel", [0, 1, 2])
def test_a_lamp_that_a_white_card_would_lack_a_colour_under_is_mirrored_without_it(
    channel: int, scene: Callable[..., Scene], model: Model
) -> None:
    """By the matrix of a strongly coloured lamp the card may give less than nothing."""
    glossy = scene()
    found = find_highlights(glossy.reduced, glossy.lamps, model.flash_white)
    assert found is not None
    colours = found.colours.copy()
    colours[0, channel] = -0.2 * colours[0].max()
    found = replace(found, colours=colours)
    bright = 2 * np.maximum(colours[0], 0.0) * glossy.mirrors[0][..., None]
    no_flash = (glossy.pair.no_flash[:] + bright).astype(np.float32)
    flash = glossy.pair.flash_part()
    even = np.full((2, *no_flash.shape), 0.5, np.float32)

    parts = found.deal_out(slice(0, len(no_flash)), no_flash, flash, glossy.lamps, even.copy())

    assert parts.min() >= 0 and parts.max() <= 1
    assert parts[0, ..., channel].min() == 0
    defined = deal_out(found, no_flash, flash, glossy.lamps, even)
    np.testing.assert_allclose(parts, defined, atol=1e-5)

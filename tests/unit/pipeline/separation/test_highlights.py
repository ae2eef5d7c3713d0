from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.arrays import Floats32, Floats64
from pipeline.images.noise import Noise
from pipeline.lamps.lamps import Lamps
from pipeline.light.model import Model
from pipeline.options import Options
from pipeline.pair.pair import Pair
from pipeline.pair.reduced import ReducedPair, reduce_pair
from pipeline.progress import Progress
from pipeline.separation import separation
from pipeline.separation.highlights import find_highlights
from pipeline.separation.separation import separate
from pipeline.spectra.cameras import Camera
from pipeline.spectra.lights import find_light, reflectance_spectra
from pipeline.spectra.matrices import best_matrix
from tests.definitions.highlights import deal_out
from tests.definitions.separation import separate as defined_separate

Mask = NDArray[np.bool_]
SIZE = (120, 160)
PLACES = ((0.25, 0.25), (0.25, 0.7), (0.72, 0.5))
"""Where the first lamp is mirrored, the second, the flash: of the height and of the width."""
RADIUS = 0.055  # of the height
LOUD = Noise(np.full(3, 1e-5), np.full(3, 1e-9))


@dataclass(frozen=True)
class Scene:
    """A pair under two lamps, its true layers (2, H, W, 3), and masks (3, H, W) of what mirrors."""

    pair: Pair
    lamps: Lamps
    layers: Floats64
    mirrors: Mask

    @property
    def reduced(self) -> ReducedPair:
        """As separate takes it."""
        return reduce_pair(self.pair)


def discs(size: tuple[int, int], radius: float = RADIUS) -> Mask:
    """Round patches (3, H, W)."""
    v, u = np.mgrid[: size[0], : size[1]]
    return np.array(
        [np.hypot(v - size[0] * y, u - size[1] * x) < radius * size[0] for y, x in PLACES]
    )


def balanced(light: Floats64) -> dict[str, Floats64]:
    """Weights of the channels, as lamps that were found have them."""
    return {"channel_weights": 1 / light.mean(axis=(0, 1))}


def noisy(
    light: Floats64, flash: Floats64, noise: Noise | None, pair_of: Callable[..., Pair], **more: Any
) -> Pair:
    """A pair with the noise of a sensor, which it says that it has."""
    if not noise:
        return pair_of(light, flash, **more)
    grain = np.random.default_rng(8).normal(size=(2, *light.shape))
    before = light + grain[0] * np.sqrt(noise.variance(light))
    after = light + flash + grain[1] * np.sqrt(noise.variance(light + flash))
    return pair_of(before, after - before, no_flash_noise=noise, flash_noise=noise, **more)


@pytest.fixture
def paints(surfaces: Floats64, model: Model) -> Floats64:
    """Measured surfaces (m, 3) under the flash, those of the most saturated colours first."""
    white = model.flash_white / model.flash_white.sum()
    off = surfaces / surfaces.sum(axis=1, keepdims=True) - white
    return surfaces[np.argsort(-np.linalg.norm(off, axis=1))]


@pytest.fixture
def scene(
    model: Model,
    paints: Floats64,
    pair_of: Callable[..., Pair],
    lamps_of: Callable[..., Lamps],
    warm_to_cool: Floats64,
) -> Callable[..., Scene]:
    """Make red paint in even light, with patches that mirror one lamp, the other, and the flash.

    Below the middle the paint is paler, but for the last patch, which looks as pale under the flash
    since it mirrors that. gloss, of_flash: how much is mirrored of lamps, and of the flash. radius:
    of the patches.
    """

    def build(
        gloss: float = 0.1,
        of_flash: float = 0.03,
        size: tuple[int, int] = SIZE,
        noise: Noise | None = None,
        paint: Floats64 = paints[0],
        radius: float = RADIUS,
        **more: Any,
    ) -> Scene:
        chosen, mirrors = warm_to_cool[[0, 2]], discs(size, radius)
        matrices, white = model.lamp_matrix(chosen), model.flash_white
        v, u = np.mgrid[: size[0], : size[1]] / np.array(size)[:, None, None]
        shading = (0.8 - 0.6 * ((u - 0.5) ** 2 + (v - 0.5) ** 2))[..., None]
        pale = paint + of_flash * white * (v > 0.5)[..., None]
        flash = shading * pale
        matt = shading * np.where(mirrors[2][..., None], paint, pale)
        z = np.stack([0.6 - 0.4 * u, 0.2 + 0.4 * u])
        layers = np.einsum("nhw,nkl,hwl->nhwk", z, matrices, matt)
        layers += gloss * mirrors[:2, ..., None] * (matrices @ white)[:, None, None]
        light = layers.sum(axis=0)
        pair = noisy(light, flash, noise, pair_of, **more)
        return Scene(pair, lamps_of(chosen, **balanced(light)), layers, mirrors)

    return build


@pytest.fixture
def layers_by(model: Model, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Floats32]:
    """Layers that separate gives of a scene, in strips; without highlights by matt light alone."""

    def run(scene: Scene, rows: int = 1000, highlights: bool = True) -> Floats32:
        with monkeypatch.context() as patch:
            if not highlights:
                patch.setattr(separation, "find_highlights", lambda *_: None)
            strips = separate(
                scene.pair, scene.reduced, scene.lamps, model, Options(), Progress(), rows
            )
            return np.concatenate([strip.layers for strip in strips], axis=1)

    return run


def off(found: NDArray[Any], scene: Scene, where: Mask) -> float:
    """Relative error of the layers in some places."""
    error = np.linalg.norm((found - scene.layers)[:, where])
    return float(error / np.linalg.norm(scene.layers[:, where]))


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
    glossy = replace(glossy, pair=replace(glossy.pair, no_flash=no_flash, flash=flash))
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

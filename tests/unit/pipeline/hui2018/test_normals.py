from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import permutations
from typing import Any

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.errors import OptionError
from pipeline.hui2018.normals import assign_lamps, published_normals
from pipeline.images.frames import Image
from pipeline.lamps.lamps import Lamps
from pipeline.light.model import Model
from pipeline.options import DirectedLight
from pipeline.pair.reduced import reduce_pair
from pipeline.separation.separation import Strip
from tests.angles import angles

HEIGHT, WIDTH, FOCAL_PX = 80, 100, 140.0
DIRECTIONS = np.array([[0.6, 0.2, 1.0], [-0.5, 0.5, 1.0], [0.1, -0.7, 1.1]])
STRENGTHS = (1.0, 0.6, 0.8)


def unit(vectors: Floats64) -> Floats64:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def view(focal_px: float = FOCAL_PX) -> Floats64:
    """Unit vectors (h, w, 3) from the surface to the camera."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    right, up = x - (WIDTH - 1) / 2, (HEIGHT - 1) / 2 - y
    return unit(np.stack([-right, -up, np.full(x.shape, focal_px)], axis=-1))


def ball() -> Floats64:
    """Unit normals (h, w, 3) of a ball that fills the picture, none tilted beyond 35°."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    right, up = (x - WIDTH / 2) / 110, (HEIGHT / 2 - y) / 110
    return np.stack([right, up, np.sqrt(1 - right**2 - up**2)], axis=-1)


def saddle() -> Floats64:
    """Unit normals (h, w, 3) of z = x·y / 400, gently twisted and nowhere steep."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    right, up = (x - WIDTH / 2) / 400, (HEIGHT / 2 - y) / 400
    return unit(np.stack([-up, -right, np.ones(x.shape)], axis=-1))


def lights(
    order: Sequence[int] = (0, 1, 2),
    strengths: Sequence[float | None] = STRENGTHS,
    rgb: Floats64 | None = None,
    scale: float = 1.0,
) -> list[DirectedLight]:
    """The three lamps as a user describes them, in some order."""
    return [
        DirectedLight(
            direction=(*(scale * DIRECTIONS[j]),),
            strength=strengths[j],
            rgb=None if rgb is None else (*rgb[j],),
        )
        for j in order
    ]


def relative(strengths: Floats64) -> Floats64:
    """Strengths, the largest 1: only their ratios mean anything."""
    return np.asarray(strengths / strengths.max())


@pytest.fixture
def shone(
    model: Model, surfaces: Floats64, warm_to_cool: Floats64, pair_of: Callable[..., Any]
) -> Callable[..., tuple[Any, Strip]]:
    """A body of many materials that the model describes exactly, under three distant lamps."""

    def build(
        facing: Floats64 | None = None,
        materials: int = 12,
        focal_px: float = FOCAL_PX,
        glossy: float = 0.0,
    ) -> tuple[Any, Strip]:
        """glossy: by how much the flash may come back brighter or fainter than matt."""
        field = ball() if facing is None else facing
        rng = np.random.default_rng(6)
        kinds = rng.integers(0, materials, (HEIGHT // 10, WIDTH // 10)).repeat(10, 0).repeat(10, 1)
        albedo = surfaces[rng.integers(0, len(surfaces), materials)][kinds]
        flash = 0.6 * albedo * np.maximum((field * view(focal_px)).sum(-1), 0.0)[..., None]
        flash *= rng.uniform(1 - glossy, 1 + glossy, (HEIGHT, WIDTH, 1))
        matrices = model.lamp_matrix(warm_to_cool)
        greens = (matrices @ model.flash_white)[:, 1]
        lit = np.maximum(field @ unit(DIRECTIONS).T, 0.0) * STRENGTHS / greens
        layers = np.einsum("hwj,jkl,hwl->jhwk", 0.6 * lit, matrices, albedo)
        pair = pair_of(layers.sum(axis=0), flash)
        confidence = np.ones((HEIGHT, WIDTH), np.float32)
        part = pair.flash - pair.no_flash
        whole = slice(0, HEIGHT)
        return pair, Strip(whole, layers.astype(np.float32), pair.no_flash, part, confidence)

    return build


@pytest.fixture
def lamps(lamps_of: Callable[..., Lamps], warm_to_cool: Floats64) -> Lamps:
    """The three lamps, as if truly found."""
    return lamps_of(warm_to_cool)


@pytest.fixture
def found_normals(
    shone: Callable[..., tuple[Any, Strip]],
    model: Model,
    lamps: Lamps,
) -> Callable[[list[DirectedLight]], tuple[Image, Floats64]]:
    """Normals of the ball, and the strengths used."""

    def run(given: list[DirectedLight]) -> tuple[Image, Floats64]:
        pair, strip = shone()
        directed = assign_lamps(given, reduce_pair(pair), lamps, model, FOCAL_PX)
        return published_normals(strip, lamps, directed), directed.strengths

    return run


@pytest.mark.parametrize("order", list(permutations(range(3))))
def test_known_lights_give_the_normals(
    found_normals: Callable[..., tuple[Image, Floats64]],
    warm_to_cool: Floats64,
    order: tuple[int, ...],
) -> None:
    found, strengths = found_normals(lights(order, rgb=warm_to_cool))

    assert found.dtype == np.float32
    assert np.isfinite(found).mean() > 0.98
    known = np.isfinite(found[..., 0])
    np.testing.assert_allclose(np.linalg.norm(found[known], axis=1), 1, rtol=1e-5)
    assert angles(found, ball())[known].max() < 0.5
    np.testing.assert_allclose(relative(strengths), np.array(STRENGTHS)[list(order)], rtol=0.01)


@pytest.mark.parametrize("order", list(permutations(range(3))))
def test_lights_without_colour_are_assigned_to_the_lamps(
    found_normals: Callable[..., tuple[Image, Floats64]], order: tuple[int, ...]
) -> None:
    """The lamps are in the order of their colours, the lights in any; only one way fits."""
    found, _ = found_normals(lights(order))

    assert np.nanmedian(angles(found, ball())) < 0.5


@pytest.mark.parametrize("order", list(permutations(range(3))))
def test_lights_are_assigned_so_that_the_normals_are_those_of_a_surface(
    shone: Callable[..., tuple[Any, Strip]],
    model: Model,
    lamps: Lamps,
    order: tuple[int, ...],
) -> None:
    """Seen from afar, nearly flat and a little glossy: the flash fits every assignment."""
    far_px = 4000.0
    pair, strip = shone(saddle(), focal_px=far_px, glossy=0.1)
    given = lights(order, strengths=(None, None, None))

    directed = assign_lamps(given, reduce_pair(pair), lamps, model, far_px)

    assert np.nanmedian(angles(published_normals(strip, lamps, directed), saddle())) < 5


@pytest.mark.parametrize("missing", [(0,), (1, 2), (0, 1, 2)])
@pytest.mark.parametrize("named", [True, False], ids=["named", "not named"])
def test_missing_strengths_are_found(
    found_normals: Callable[..., tuple[Image, Floats64]],
    warm_to_cool: Floats64,
    missing: tuple[int, ...],
    named: bool,
) -> None:
    given = [None if j in missing else STRENGTHS[j] for j in range(3)]

    found, strengths = found_normals(lights(strengths=given, rgb=warm_to_cool if named else None))

    np.testing.assert_allclose(relative(strengths), STRENGTHS, rtol=0.05)
    assert np.nanmedian(angles(found, ball())) < 1


def test_strengths_a_little_wrong_are_mended_by_the_flash(
    found_normals: Callable[..., tuple[Image, Floats64]], warm_to_cool: Floats64
) -> None:
    given = np.array(STRENGTHS) * (1.06, 0.95, 1.0)

    found, strengths = found_normals(lights(strengths=given.tolist(), rgb=warm_to_cool))

    np.testing.assert_allclose(relative(strengths), STRENGTHS, rtol=0.02)
    assert np.nanmedian(angles(found, ball())) < 0.5


@pytest.mark.parametrize("spoilt", ["shadow", "highlights", "unusable"])
def test_strengths_are_found_from_the_sound_pixels(
    shone: Callable[..., tuple[Any, Strip]],
    model: Model,
    lamps: Lamps,
    warm_to_cool: Floats64,
    spoilt: str,
) -> None:
    pair, strip = shone()
    reduced = reduce_pair(pair)
    if spoilt == "shadow":
        reduced.no_flash[:, :40] -= strip.layers[0, :, :40]
    if spoilt == "highlights":
        reduced.flash[:, 80:] *= 1.5
    if spoilt == "unusable":
        reduced.flash[:, :60] *= np.linspace(0.2, 1, 60)[:, None]
        reduced.usable[:, :60] = False
    given = lights(strengths=(None, None, None), rgb=warm_to_cool)

    directed = assign_lamps(given, reduced, lamps, model, FOCAL_PX)

    np.testing.assert_allclose(relative(directed.strengths), STRENGTHS, rtol=0.05)


def test_pixels_of_a_reduced_picture_count_as_often_as_they_are_wide(
    shone: Callable[..., tuple[Any, Strip]],
    model: Model,
    lamps: Lamps,
    warm_to_cool: Floats64,
) -> None:
    reduced = replace(reduce_pair(shone()[0]), block=3)
    given = lights(strengths=(None, None, None), rgb=warm_to_cool)

    directed = assign_lamps(given, reduced, lamps, model, 3 * FOCAL_PX)

    np.testing.assert_allclose(relative(directed.strengths), STRENGTHS, rtol=0.01)


def test_the_cameras_axis_goes_through_the_middle_of_what_was_dropped_too(
    shone: Callable[..., tuple[Any, Strip]], model: Model, lamps: Lamps, warm_to_cool: Floats64
) -> None:
    """Of a picture that is a quarter wider than whole blocks."""
    reduced = reduce_pair(shone()[0])
    some = np.s_[:, :76]
    cut = replace(
        reduced,
        no_flash=reduced.no_flash[some],
        flash=reduced.flash[some],
        usable=reduced.usable[some],
        dropped=(24, 0),
    )
    given = lights(strengths=(None, None, None), rgb=warm_to_cool)

    directed = assign_lamps(given, cut, lamps, model, FOCAL_PX)

    np.testing.assert_allclose(relative(directed.strengths), STRENGTHS, rtol=0.01)


def test_on_a_flat_surface_the_strengths_given_hold(
    shone: Callable[..., tuple[Any, Strip]],
    model: Model,
    lamps: Lamps,
    warm_to_cool: Floats64,
) -> None:
    """Surfaces that are all parallel say nothing of strengths."""
    wall = np.broadcast_to(np.array([0.0, 0.0, 1.0]), (HEIGHT, WIDTH, 3))
    pair, strip = shone(wall)

    directed = assign_lamps(lights(rgb=warm_to_cool), reduce_pair(pair), lamps, model, FOCAL_PX)

    np.testing.assert_allclose(relative(directed.strengths), STRENGTHS, rtol=0.02)
    assert np.nanmedian(angles(published_normals(strip, lamps, directed), wall)) < 0.5


def test_lengths_of_directions_do_not_matter(
    found_normals: Callable[..., tuple[Image, Floats64]], warm_to_cool: Floats64
) -> None:
    once, _ = found_normals(lights(rgb=warm_to_cool))
    long, _ = found_normals(lights(rgb=70 * warm_to_cool, scale=250.0))

    np.testing.assert_allclose(long, once, atol=1e-4)


def test_only_the_ratios_of_strengths_matter(
    found_normals: Callable[..., tuple[Image, Floats64]], warm_to_cool: Floats64
) -> None:
    once, _ = found_normals(lights(rgb=warm_to_cool))
    bright, _ = found_normals(lights(strengths=(50.0, 30.0, 40.0), rgb=warm_to_cool))

    np.testing.assert_allclose(bright, once, atol=1e-4)


def test_colours_a_little_wrong_still_name_the_lamps_found(
    found_normals: Callable[..., tuple[Image, Floats64]], warm_to_cool: Floats64
) -> None:
    found, _ = found_normals(lights(rgb=warm_to_cool * (1.3, 1.0, 0.8)))

    assert np.nanmedian(angles(found, ball())) < 0.5


def test_colours_that_do_not_fit_give_other_normals(
    found_normals: Callable[..., tuple[Image, Floats64]], warm_to_cool: Floats64
) -> None:
    """What the user says about colours is believed."""
    found, _ = found_normals(lights(rgb=warm_to_cool[[1, 2, 0]]))

    assert np.nanmedian(angles(found, ball())) > 10


@pytest.mark.parametrize("named", range(3))
def test_the_colour_of_one_light_says_which_lamp_it_is(
    found_normals: Callable[..., tuple[Image, Floats64]], warm_to_cool: Floats64, named: int
) -> None:
    given = lights()
    errors = []
    for lamp in (named, (named + 1) % 3):
        given[named] = given[named].model_copy(update={"rgb": tuple(2 * warm_to_cool[lamp])})
        errors.append(np.nanmedian(angles(found_normals(given)[0], ball())))

    assert errors[0] < 0.5
    assert errors[1] > 10


def test_the_strip_of_a_picture_has_the_normals_of_the_picture(
    shone: Callable[..., tuple[Any, Strip]],
    model: Model,
    lamps: Lamps,
) -> None:
    pair, strip = shone()
    directed = assign_lamps(lights(), reduce_pair(pair), lamps, model, FOCAL_PX)
    rows = slice(17, 31)
    part = Strip(
        rows,
        strip.layers[:, rows],
        strip.no_flash[rows],
        strip.flash[rows],
        strip.confidence[rows],
    )

    np.testing.assert_array_equal(
        published_normals(part, lamps, directed), published_normals(strip, lamps, directed)[rows]
    )


def test_unknown_normals_are_nan(
    shone: Callable[..., tuple[Any, Strip]],
    model: Model,
    lamps: Lamps,
    warm_to_cool: Floats64,
) -> None:
    """Where a lamp does not shine, and where nothing is known of the flash part."""
    pair, strip = shone()
    directed = assign_lamps(lights(rgb=warm_to_cool), reduce_pair(pair), lamps, model, FOCAL_PX)
    strip.no_flash[:10] -= strip.layers[1, :10]
    strip.no_flash[60:70] -= 0.9 * strip.layers[1, 60:70]  # dim is not dark
    strip.confidence[20:30] = 0
    strip.flash[40:45] = strip.no_flash[40:45] = 0

    found = published_normals(strip, lamps, directed)

    assert np.isnan(found[:10]).all(axis=2).mean() > 0.98
    assert np.isnan(found[20:30]).all()
    assert np.isnan(found[40:45]).all()
    assert np.isfinite(found[50:]).mean() > 0.98
    away = replace(directed, inverse=-directed.inverse)
    assert np.isnan(published_normals(strip, lamps, away)).all()


def test_directions_that_fix_no_normals_are_refused(
    shone: Callable[..., tuple[Any, Strip]], model: Model, lamps: Lamps
) -> None:
    pair, _ = shone()
    given = [DirectedLight(direction=direction) for direction in ((1, 0, 1), (0, 0, 1), (-1, 0, 1))]

    with pytest.raises(OptionError, match="nearly in one plane"):
        assign_lamps(given, reduce_pair(pair), lamps, model, FOCAL_PX)


@pytest.mark.parametrize("count", [1, 2])
@pytest.mark.parametrize("partly", [False, True], ids=["no rgb", "rgb of two"])
def test_fewer_than_three_lamps_are_refused_unless_all_colours_are_given(
    shone: Callable[..., tuple[Any, Strip]],
    model: Model,
    lamps_of: Callable[..., Any],
    warm_to_cool: Floats64,
    count: int,
    partly: bool,
) -> None:
    pair, strip = shone()
    lamps = lamps_of(warm_to_cool[:count])
    given = lights(rgb=warm_to_cool)
    unnamed = [lights()[j] if not partly or j == 1 else given[j] for j in range(3)]

    with pytest.raises(OptionError, match=r"Normals need three lamps, and the number found is \d"):
        assign_lamps(unnamed, reduce_pair(pair), lamps, model, FOCAL_PX)

    directed = assign_lamps(given, reduce_pair(pair), lamps, model, FOCAL_PX)
    assert np.nanmedian(angles(published_normals(strip, lamps, directed), ball())) < 0.5


def test_a_picture_without_light_has_no_normals(
    pair_of: Callable[..., Any],
    model: Model,
    lamps: Lamps,
) -> None:
    dark = np.zeros((40, 50, 3))
    pair = pair_of(dark, dark)
    nothing = Strip(
        rows=slice(0, 40),
        layers=np.zeros((3, 40, 50, 3), np.float32),
        no_flash=pair.no_flash,
        flash=pair.no_flash,
        confidence=np.ones((40, 50), np.float32),
    )

    directed = assign_lamps(lights(), reduce_pair(pair), lamps, model, FOCAL_PX)

    assert np.isnan(published_normals(nothing, lamps, directed)).all()

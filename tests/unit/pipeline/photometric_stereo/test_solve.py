from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import permutations
from typing import Any

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.errors import Canceled, InputError, OptionError, UnusablePairError
from pipeline.images.frames import Mask
from pipeline.lamps.lamps import Lamps
from pipeline.light.model import Model
from pipeline.options import DirectedLight
from pipeline.pair.reduced import reduce_pair
from pipeline.photometric_stereo import solve as solve_module
from pipeline.photometric_stereo.fit import fit
from pipeline.photometric_stereo.responses import LampBank
from pipeline.photometric_stereo.scene import Scene, State
from pipeline.photometric_stereo.solve import Surface, _finer, solve_surface
from pipeline.photometric_stereo.view import View
from pipeline.progress import Progress


@pytest.fixture(scope="module")
def solved(
    pair_of: Callable[..., Any],
    lamps_of: Callable[..., Lamps],
    model: Model,
) -> Callable[..., Surface]:
    """Solve for a ball. whites: (J, 3) colours of the lamps found, in any order."""

    def build(
        ball: Any,
        lights: list[DirectedLight],
        whites: Floats64 | None = None,
        fill: int = 1,
        progress: Progress | None = None,
    ) -> Surface:
        """fill: how often every pixel is repeated, in both directions."""
        light, flash = (one.repeat(fill, 0).repeat(fill, 1) for one in (ball.light, ball.flash))
        pair = pair_of(0.3 * light, 0.3 * flash)
        found = lamps_of(ball.colours if whites is None else whites)
        return solve_surface(
            lights,
            reduce_pair(pair),
            found,
            model,
            fill * ball.focal_px,
            progress or Progress(),
        )

    return build


def error(ball: Any, surface: Surface) -> float:
    length = np.linalg.norm(surface.w, axis=2, keepdims=True)
    normals = surface.w / np.where(length > 0, length, 1)
    return float(ball.error(normals, ball.lit & surface.mask))


@pytest.mark.parametrize("said", [("strength", "rgb"), ("rgb",)])
def test_normals_depth_and_strengths_are_found(
    ball: Callable[..., Any], solved: Callable[..., Surface], said: tuple[str, ...]
) -> None:
    one = ball(48, 3)

    surface = solved(one, one.lights(*said))

    known = one.lit & surface.mask
    assert known.sum() > 0.99 * one.lit.sum()
    assert error(one, surface) < 0.6
    np.testing.assert_allclose(surface.strengths, [1 / 1.2, 0.7 / 1.2, 1], rtol=0.03)
    ratio = surface.z[known] / one.depth[known]
    assert np.std(ratio / ratio.mean()) * 2 < 0.005 * 10  # relief is a fifth of the distance
    assert np.median(surface.z[surface.mask]) == pytest.approx(1)
    assert (surface.w[~surface.mask] == 0).all()
    assert surface.block == 1
    assert surface.misfit < 0.005


def test_directions_that_are_off_are_told(
    ball: Callable[..., Any], solved: Callable[..., Surface]
) -> None:
    one = ball(48, 3)

    right, off = (solved(one, some.lights("strength", "rgb")) for some in (one, one.turned(8)))

    assert right.turned_deg == pytest.approx(0, abs=1e-4)
    assert off.turned_deg == pytest.approx(8, abs=1)
    np.testing.assert_allclose(off.directions, one.directions, atol=0.03)
    assert error(one, off) < 0.7


def test_strengths_beside_the_flash_are_found(
    ball: Callable[..., Any], solved: Callable[..., Surface]
) -> None:
    """Of two lamps a material may take over what one shines more than the other."""
    surface = solved(one := ball(48, 3, lamps=2), one.lights("rgb"))

    np.testing.assert_allclose(surface.strengths, [1, 0.7], rtol=0.02)


def test_directions_alone_will_do(ball: Callable[..., Any], solved: Callable[..., Surface]) -> None:
    """The lamps found may come in any order, and their colours be a little off."""
    one = ball(48, 3)
    whites = one.colours[[2, 0, 1]] * [1.02, 1.0, 0.98]

    surface = solved(one, one.lights(), whites)

    assert error(one, surface) < 1.0


@pytest.mark.parametrize("named", [0, 1])
def test_the_colour_of_one_of_two_lights_settles_which_is_which(
    ball: Callable[..., Any], solved: Callable[..., Surface], named: int
) -> None:
    """What the user says is believed, also where the other order explains the pair better."""
    one = ball(24, 3, lamps=2)

    def error_with(colour: Floats64) -> float:
        lights = one.lights("strength")
        lights[named] = lights[named].model_copy(update={"rgb": tuple(colour)})
        return error(one, solved(one, lights))

    assert error_with(one.colours[named]) < 3
    assert error_with(one.colours[1 - named]) > 10


def test_two_lamps_and_the_flash_will_do(
    ball: Callable[..., Any], solved: Callable[..., Surface]
) -> None:
    one = ball(48, 3, lamps=2)

    surface = solved(one, one.lights("strength", "rgb"))

    assert error(one, surface) < 1.0
    assert surface.lit.shape[2] == 2


@pytest.mark.parametrize(("said", "least"), [(("strength", "rgb"), 20), (("strength",), 6 * 20)])
def test_it_tells_how_far_it_is_at_every_scale(
    ball: Callable[..., Any], solved: Callable[..., Surface], said: tuple[str, ...], least: int
) -> None:
    """Two starts of ten scales each, of every order of lamps whose colours are not known."""
    one, heard = ball(24), []

    solved(one, one.lights(*said), progress=Progress(lambda *report: heard.append(report)))

    assert {stage for stage, _ in heard} == {"lamps"}
    fractions = [fraction for _, fraction in heard]
    assert len(fractions) >= least
    assert fractions == sorted(fractions)
    assert fractions[0] == 0.5
    assert fractions[-1] < 1
    assert len(set(fractions)) == len(fractions)


def test_it_can_be_canceled_at_every_scale(
    ball: Callable[..., Any], solved: Callable[..., Surface]
) -> None:
    one, heard = ball(24), []
    progress = Progress(lambda *report: heard.append(report), lambda: len(heard) == 7)

    with pytest.raises(Canceled):
        solved(one, one.lights("strength", "rgb"), progress=progress)

    assert len(heard) == 7


def test_lengths_of_directions_mean_nothing(
    ball: Callable[..., Any], solved: Callable[..., Surface]
) -> None:
    one = ball(24)
    lights = one.lights("strength", "rgb")
    longer = [
        light.model_copy(update={"direction": tuple(3 * x for x in light.direction)})
        for light in lights
    ]

    np.testing.assert_allclose(solved(one, longer).w, solved(one, lights).w, rtol=1e-6)


def test_a_large_picture_is_solved_at_a_reduced_size(
    ball: Callable[..., Any], solved: Callable[..., Surface]
) -> None:
    one = ball(64)

    surface = solved(one, one.lights("strength", "rgb"), fill=10)

    assert surface.block * len(surface.mask) <= 640
    assert surface.mask.sum() < 60_000
    step = surface.block / 10
    centres = ((np.arange(len(surface.mask)) + 0.5) * step).astype(int)
    known = surface.mask & one.lit[np.ix_(centres, centres)]
    w = surface.w[known]
    cosine = (w * one.normals[np.ix_(centres, centres)][known]).sum(axis=1)
    angle = np.degrees(np.arccos(np.clip(cosine / np.linalg.norm(w, axis=1), -1, 1)))
    assert np.median(angle) < 1.5  # a pixel of the ball spans 2°


def test_directions_that_fix_nothing_are_refused(
    ball: Callable[..., Any], solved: Callable[..., Surface]
) -> None:
    with pytest.raises(OptionError, match="nearly in one plane"):
        solved(ball(32), [DirectedLight(direction=(0.0, 0.0, 1.0))] * 3)


def test_as_many_lamps_as_directions_are_needed(
    ball: Callable[..., Any], solved: Callable[..., Surface]
) -> None:
    one = ball(32)

    with pytest.raises(
        OptionError,
        match=r"3 light directions, and the number of lamps is 2: give the directions of those "
        r"lamps alone, or the rgb",
    ):
        solved(one, one.lights(), one.colours[:2])


@pytest.mark.parametrize("said", [("strength", "rgb"), ("strength",)])
def test_more_lamps_than_directions_are_refused_whatever_their_colours(
    ball: Callable[..., Any], solved: Callable[..., Surface], said: tuple[str, ...]
) -> None:
    """The light of the third would tilt the normals."""
    one = ball(32)

    with pytest.raises(
        OptionError,
        match=r"2 light directions, and the number of lamps is 3: give a direction for each lamp",
    ):
        solved(one, one.lights(*said)[:2])


def test_fewer_lamps_found_than_directions_will_do_with_the_colour_of_each(
    ball: Callable[..., Any], solved: Callable[..., Surface]
) -> None:
    one = ball(32)

    surface = solved(one, one.lights("strength", "rgb"), one.colours[:2])

    assert error(one, surface) < 1.0


@pytest.mark.parametrize("said", [("rgb",), ()])
def test_lamps_are_first_thought_to_be_as_layers_were_separated_by(
    ball: Callable[..., Any],
    lamps_of: Callable[..., Lamps],
    model: Model,
    said: tuple[str, ...],
) -> None:
    """The lamps found are in another order than the directions; fewer tell none."""
    one = ball(10)
    lamps = lamps_of(one.colours[[2, 0, 1]])

    likely = solve_module._likely(one.lights(*said), lamps, model)

    orders = [[1, 2, 0]] if said else list(permutations(range(3)))
    assert len(likely) == len(orders)
    for few, order in zip(likely, orders, strict=True):
        np.testing.assert_array_equal([matrix for *_, matrix in few], lamps.matrices[list(order)])
        assert {measured for _, measured, _ in few} == {bool(said)}
    (fewer,) = solve_module._likely(one.lights("rgb"), lamps_of(one.colours[:2]), model)
    assert [matrix for *_, matrix in fewer] == [None] * 3


def test_a_picture_with_hardly_any_light_is_refused(
    ball: Callable[..., Any], solved: Callable[..., Surface]
) -> None:
    one = ball(10)

    with pytest.raises(UnusablePairError, match="Too few pixels"):
        solved(one, one.lights("strength", "rgb"))


@pytest.mark.parametrize("said", [("strength", "rgb"), ("strength",)])
@pytest.mark.parametrize(
    "lit", [np.s_[::4], np.s_[::4, ::4], np.s_[::3, ::2]], ids=["wires", "specks", "net"]
)
def test_light_on_thin_or_scattered_places_is_refused(
    ball: Callable[..., Any], solved: Callable[..., Surface], lit: Any, said: tuple[str, ...]
) -> None:
    """More pixels than are fitted to at once, none of whose blocks shows half of one."""
    large = ball(400)
    shown = np.zeros((400, 400), bool)
    shown[lit] = True
    thin = replace(
        large, lamps=large.lamps * shown[..., None], flash=large.flash * shown[..., None]
    )

    with pytest.raises(UnusablePairError, match="lie too thinly or scattered"):
        solved(thin, large.lights(*said))


@pytest.mark.parametrize("seed", range(3))
def test_light_without_sense_is_solved_or_refused(
    pair_of: Callable[..., Any],
    lamps_of: Callable[..., Lamps],
    ball: Callable[..., Any],
    model: Model,
    seed: int,
) -> None:
    """Noise for a picture: no crash, no unending search, and no number that is none."""
    random = np.random.default_rng(seed)
    one = ball(32)
    pair = pair_of(random.uniform(0.01, 0.4, (24, 24, 3)), random.uniform(0.01, 0.4, (24, 24, 3)))
    reduced, lamps = reduce_pair(pair), lamps_of(one.colours)

    try:
        surface = solve_surface(one.lights("rgb"), reduced, lamps, model, 80.0, Progress())
    except InputError:
        return

    assert np.isfinite(surface.w).all()
    assert np.isfinite(surface.z[surface.mask]).all()


def test_a_stray_speck_is_left_out_where_a_seam_is_cut(
    ball: Callable[..., Any], solved: Callable[..., Surface], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The seam is cut before the fit to all pixels, which has no corners then for the speck."""
    one = ball(32)
    lamps, flash = one.lamps.copy(), one.flash.copy()
    speck, seam = np.s_[1:3, 1:3], np.s_[15:17]
    lamps[:, *speck], flash[speck] = lamps[:, 8:9, 16:17], flash[8, 16]

    def fit_without_seam(scene: Scene, tick: Callable[[], None]) -> tuple[Scene, State]:
        off = np.zeros(scene.grid.mask.shape, bool)
        off[seam] = True
        left = scene.without(off[scene.grid.mask])
        return left, fit(left, tick)[0]

    monkeypatch.setattr(solve_module, "fit_in_parts", fit_without_seam)

    surface = solved(replace(one, lamps=lamps, flash=flash), one.lights("strength", "rgb"))

    assert surface.mask[speck].all() and surface.cut[speck].all()
    np.testing.assert_array_equal(surface.cut[seam], surface.mask[seam])
    rest = one.lit & ~surface.cut
    assert rest.sum() > 0.85 * one.lit.sum()
    assert surface.unexplained == pytest.approx(
        surface.mask[seam].sum() / surface.mask.sum(), abs=0.01
    )
    normals = surface.w / np.linalg.norm(surface.w, axis=2, keepdims=True).clip(min=1e-9)
    assert one.error(normals, rest) < 2


def test_a_mask_on_a_finer_view_covers_the_same_places() -> None:
    mask = np.array([[True, False, False], [False, True, True]])
    finer = _finer(mask, 4, 2, (5, 6))
    expected = np.repeat(np.repeat(mask, 2, axis=0), 2, axis=1)
    np.testing.assert_array_equal(finer, np.vstack([expected, expected[-1]]))  # the last goes on


def test_tiles_between_dark_joints_keep_to_the_parts_that_were_cut(bank: LampBank) -> None:
    """Of 3 × 3 pixels each, a crumb of the surface; a coarse view does not show their joints."""
    flash = np.full((48, 48, 3), 0.5)
    flash[:, 24:] /= 2
    tiles, whole = np.ones((48, 48), bool), np.ones((24, 24), bool)
    tiles[2::4] = tiles[:, 2::4] = False

    def view(step: int, mask: Mask) -> View:
        some = flash[::step, ::step]
        noise = np.full_like(some, 1e-8)
        middle = 24 / step - 0.5
        return View(
            step, 60 / step, (middle, middle), mask, some, some / 2, noise, noise, 0 * noise
        )

    fine = view(1, tiles)
    priors = (bank.prior(np.ones(3)), bank.prior(np.array([1.0, 0.8, 0.5])))
    scene = fine.scene(np.array([[0.6, 0, 0.8], [0, 0.6, 0.8]]), priors, fine.materials())
    kept = whole.copy()
    kept[:, 12] = False
    views = {solve_module._COARSE: view(2, whole), solve_module._FINE: fine}

    left, belongs = solve_module._in_parts(scene, views, kept)

    one, other = np.s_[:, :22], np.s_[:, 27:]
    assert set(belongs[one][tiles[one]]) == {1}
    assert set(belongs[other][tiles[other]]) == {2}
    assert not left.grid.mask[:, 24:26].any()
    np.testing.assert_array_equal(left.grid.mask[one], tiles[one])
    np.testing.assert_array_equal(left.grid.mask[other], tiles[other])


@pytest.mark.parametrize("fill", [1, 3])
def test_pixels_at_a_jump_of_depth_lie_on_their_own_side(
    ball: Callable[..., Any], solved: Callable[..., Surface], fill: int
) -> None:
    """The right half of a ball is farther than the left one, and larger, and so looks the same."""
    one = ball(40)
    right = np.arange(40) >= 22
    flash = one.flash / np.where(right, 1.2**2, 1)[:, None]

    surface = solved(replace(one, flash=flash), one.lights("strength", "rgb"), fill=fill)

    side = len(surface.mask) // 40
    depth = one.depth.repeat(side, 0).repeat(side, 1)
    middle = np.s_[12 * side : 28 * side]
    relative = (surface.z / np.where(surface.mask, depth, np.nan))[middle]
    left = np.nanmedian(relative[:, 10 * side : 20 * side])
    for column in range(19 * side, 25 * side):
        expected = left * (1.2 if right[column // side] else 1.0)
        np.testing.assert_allclose(relative[:, column], expected, rtol=0.03)
    assert surface.cut.any()


def test_a_seam_beside_the_jump_leaves_out_what_lies_between(
    ball: Callable[..., Any], solved: Callable[..., Surface], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The seam is cut a pixel to the left of where the right half begins to be farther."""
    one = ball(32)
    flash = one.flash / np.where(np.arange(32) >= 17, 1.3**2, 1)[:, None]

    def fit_with_seam(scene: Scene, tick: Callable[[], None]) -> tuple[Scene, State]:
        off = np.zeros(scene.grid.mask.shape, bool)
        off[:, 15] = True
        left = scene.without(off[scene.grid.mask])
        return left, fit(left, tick)[0]

    monkeypatch.setattr(solve_module, "fit_in_parts", fit_with_seam)

    surface = solved(replace(one, flash=flash), one.lights("strength", "rgb"))

    rows = slice(8, 24)
    assert surface.cut[rows, 15:17].all()
    assert not surface.cut[rows, :14].any() and not surface.cut[rows, 18:].any()
    np.testing.assert_array_equal(surface.z[rows, 15], surface.z[rows, 14])
    np.testing.assert_array_equal(surface.z[rows, 16], surface.z[rows, 14])
    assert (surface.z[rows, 17] > 1.1 * surface.z[rows, 14]).all()

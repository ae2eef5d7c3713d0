from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.errors import Canceled
from pipeline.images.noise import Noise
from pipeline.images.sigma_filter import sigma_filter
from pipeline.light.model import Model
from pipeline.options import Options
from pipeline.pair.reduced import reduce_pair
from pipeline.pair.relative_blur import blur_kernel, blurred
from pipeline.progress import Progress
from pipeline.separation.separation import Strip, separate, separate_reduced
from tests.definitions import separation as definition

Exact = Callable[..., tuple[Any, Floats64]]
LOUD = Noise(np.full(3, 2e-4), np.full(3, 1e-6))


@pytest.fixture
def separated(model: Model) -> Callable[..., Strip]:
    """Separate a pair into one strip, put together from strips of so many rows."""

    def run(
        pair: Any, lamps: Any, method: Any = "best", rows: int = 1000, quality: Any = "best"
    ) -> Strip:
        options = Options(method=method, quality=quality)
        strips = list(separate(pair, reduce_pair(pair), lamps, model, options, Progress(), rows))
        tops = [strip.rows.start for strip in strips]
        assert tops == list(range(0, len(pair.unusable), rows))
        return Strip(
            rows=slice(0, strips[-1].rows.stop),
            layers=np.concatenate([strip.layers for strip in strips], axis=1),
            no_flash=np.concatenate([strip.no_flash for strip in strips]),
            flash=np.concatenate([strip.flash for strip in strips]),
            confidence=np.concatenate([strip.confidence for strip in strips]),
        )

    return run


@pytest.fixture
def grainy(exact: Exact, pair_of: Callable[..., Any], warm_to_cool: Floats64) -> Callable[..., Any]:
    """A pair with the noise of a sensor, a clipped place, and corners the flash does not reach."""

    def build(count: int = 2, **more: Any) -> tuple[Any, Floats64]:
        chosen = warm_to_cool if count == 3 else warm_to_cool[[0, 2]][:count]
        clean, layers = exact(chosen)
        rng = np.random.default_rng(8)
        part = clean.flash - clean.no_flash
        part[:10, :10] = 0
        before, after = (
            light + rng.normal(size=light.shape) * np.sqrt(2e-4 * light + 1e-6)
            for light in (clean.no_flash.astype(np.float64), clean.no_flash + part)
        )
        clipped = np.zeros(before.shape[:2], bool)
        clipped[40:44, 50:60] = True
        noise = {"no_flash_noise": LOUD, "flash_noise": LOUD}
        given = {"unusable": clipped, **noise, **more}
        return pair_of(before, after - before, **given), layers

    return build


@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize("flash_only", [False, True])
def test_paper_is_exact_in_the_model(
    exact: Exact,
    separated: Callable[..., Strip],
    lamps_of: Callable[..., Any],
    warm_to_cool: Floats64,
    count: int,
    flash_only: bool,
) -> None:
    pair, layers = exact(warm_to_cool[:count], flash_only=flash_only)

    found = separated(pair, lamps_of(warm_to_cool[:count]), "paper")

    np.testing.assert_allclose(found.layers, layers, atol=3e-5)


@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize("flash_only", [False, True])
def test_best_is_near_the_truth_in_the_model(
    exact: Exact,
    separated: Callable[..., Strip],
    lamps_of: Callable[..., Any],
    warm_to_cool: Floats64,
    count: int,
    flash_only: bool,
) -> None:
    """Not exact, since light is taken to be smooth, and here it has kinks in a small picture."""
    pair, layers = exact(warm_to_cool[:count], flash_only=flash_only)

    found = separated(pair, lamps_of(warm_to_cool[:count]))

    error = np.square(found.layers - layers).sum() / np.square(layers).sum()
    assert 10 * np.log10(1 / error) > 22
    assert found.confidence.min() > 0.9


@pytest.mark.parametrize("times", [0.001, 0.1, 100.0])
def test_a_flash_part_alone_may_be_in_any_units(
    exact: Exact,
    separated: Callable[..., Strip],
    lamps_of: Callable[..., Any],
    warm_to_cool: Floats64,
    times: float,
) -> None:
    loud = Noise(np.full(3, 1e-3), np.full(3, 1e-6))  # so that proportions are smoothed
    more = {"no_flash_noise": loud, "flash_noise": loud, "flash_only": True}
    pair, _ = exact(warm_to_cool[:2], **more)
    noise = pair.flash_noise.divided(1 / times)
    other = replace(pair, flash=np.float32(times) * pair.flash[:], flash_noise=noise)

    layers, found = (separated(one, lamps_of(warm_to_cool[:2])).layers for one in (pair, other))

    np.testing.assert_allclose(found, layers, atol=2e-4)


def test_noise_that_nobody_sees_is_not_averaged(
    exact: Exact,
    separated: Callable[..., Strip],
    lamps_of: Callable[..., Any],
    warm_to_cool: Floats64,
) -> None:
    """What rounding to 16 bits does is no reason to smooth the kinks of the light."""
    noise = Noise(np.full(3, 1e-8), np.full(3, 1e-13))
    chosen = warm_to_cool[[0, 2]]
    pair, layers = exact(chosen, no_flash_noise=noise, flash_noise=noise)

    found = separated(pair, lamps_of(chosen))

    error = np.square(found.layers - layers).sum() / np.square(layers).sum()
    assert 10 * np.log10(1 / error) > 90


@pytest.mark.parametrize("count", [1, 2, 3])
def test_layers_of_best_add_up_to_the_photograph(
    grainy: Callable[..., Any],
    separated: Callable[..., Strip],
    lamps_of: Callable[..., Any],
    warm_to_cool: Floats64,
    count: int,
) -> None:
    """In every pixel: clipped, dark, noisy and negative ones, too."""
    pair, _ = grainy(count)
    chosen = warm_to_cool if count == 3 else warm_to_cool[[0, 2]][:count]
    assert (pair.no_flash < 0).any()

    found = separated(pair, lamps_of(chosen))

    np.testing.assert_allclose(found.layers.sum(axis=0), pair.no_flash, rtol=3e-6, atol=1e-7)


@pytest.mark.parametrize("method", ["best", "paper"])
@pytest.mark.parametrize("rows", [1, 7, 23, 63, 64])
@pytest.mark.parametrize("registration", [0.0, 0.35])
def test_results_do_not_depend_on_the_strips_by_a_bit(
    grainy: Callable[..., Any],
    separated: Callable[..., Strip],
    lamps_of: Callable[..., Any],
    warm_to_cool: Floats64,
    method: str,
    rows: int,
    registration: float,
) -> None:
    pair, _ = grainy(3, registration_px=registration)
    lamps = lamps_of(warm_to_cool)

    whole, cut = separated(pair, lamps, method), separated(pair, lamps, method, rows)

    for name in ("layers", "no_flash", "flash", "confidence"):
        np.testing.assert_array_equal(getattr(cut, name), getattr(whole, name))


def test_best_is_less_noisy_than_paper(
    grainy: Callable[..., Any],
    separated: Callable[..., Strip],
    lamps_of: Callable[..., Any],
    warm_to_cool: Floats64,
) -> None:
    pair, layers = grainy(2)
    lamps = lamps_of(warm_to_cool[[0, 2]])
    good = np.ones(pair.unusable.shape, bool)
    good[:14, :14] = False
    good[36:48, 46:64] = False

    def error(method: str) -> float:
        found = separated(pair, lamps, method).layers
        return float(np.square(found - layers)[:, good].sum() / np.square(layers)[:, good].sum())

    assert error("best") < 0.5 * error("paper")


def test_clipped_pixels_and_their_neighbours_are_filled_in(
    exact: Exact,
    separated: Callable[..., Strip],
    lamps_of: Callable[..., Any],
    pair_of: Callable[..., Any],
    warm_to_cool: Floats64,
) -> None:
    clean, layers = exact(warm_to_cool[[0, 2]])
    clipped = np.zeros(clean.unusable.shape, bool)
    clipped[20:24, 30:36] = True
    flash = clean.flash - clean.no_flash
    flash[clipped] = [0.9, 0.1, 0.9]
    pair = pair_of(clean.no_flash, flash, unusable=clipped)

    found = separated(pair, lamps_of(warm_to_cool[[0, 2]]))

    expected = np.zeros(clipped.shape, bool)
    expected[19:25, 29:37] = True
    np.testing.assert_array_equal(found.confidence == 0, expected)
    error = np.abs(found.layers - layers)[:, clipped].mean()
    assert error < 0.15 * layers.sum(axis=0)[clipped].mean()


def test_places_the_flash_does_not_reach_are_filled_in(
    grainy: Callable[..., Any],
    separated: Callable[..., Strip],
    lamps_of: Callable[..., Any],
    warm_to_cool: Floats64,
) -> None:
    """The corner is lit by the first lamp alone, as are its surroundings."""
    pair, layers = grainy(2)

    found = separated(pair, lamps_of(warm_to_cool[[0, 2]]))

    corner = (slice(None), slice(0, 9), slice(0, 9))
    assert np.median(found.confidence[corner[1:]]) < 0.5
    assert found.confidence[30, 48] > 0.8
    right = np.abs(found.layers - layers)[corner].mean()
    assert right < 0.2 * layers.sum(axis=0)[corner[1:]].mean()


def test_paper_leaves_clipped_pixels_as_they_come_but_says_so(
    grainy: Callable[..., Any],
    separated: Callable[..., Strip],
    lamps_of: Callable[..., Any],
    warm_to_cool: Floats64,
) -> None:
    pair, _ = grainy(2)

    found = separated(pair, lamps_of(warm_to_cool[[0, 2]]), "paper")

    assert not found.confidence[39:45, 49:61].any()
    assert set(np.unique(found.confidence)) == {0.0, 1.0}


@pytest.mark.parametrize("method", ["best", "paper"])
@pytest.mark.parametrize("flash_only", [False, True])
def test_a_pair_with_nothing_to_use_stays_finite(
    pair_of: Callable[..., Any],
    separated: Callable[..., Strip],
    lamps_of: Callable[..., Any],
    warm_to_cool: Floats64,
    flash_only: bool,
    method: str,
) -> None:
    dark = np.zeros((40, 48, 3))
    unusable = np.ones((40, 48), bool)
    pair = pair_of(dark, dark, unusable=unusable, flash_only=flash_only)

    found = separated(pair, lamps_of(warm_to_cool), method)

    assert not found.layers.any()
    assert not found.confidence.any()


def test_layers_are_as_sharp_as_the_photograph_they_are_of(
    exact: Exact,
    separated: Callable[..., Strip],
    lamps_of: Callable[..., Any],
    warm_to_cool: Floats64,
) -> None:
    """Where the flash photograph is less sharp, lamps are told by the other blurred as much."""
    sharp, layers = exact(warm_to_cool[[0, 2]])
    kernel = blur_kernel(np.diag([2.0, 1.0]))
    no_flash, flash = blurred(sharp.no_flash, kernel), blurred(sharp.flash, kernel)
    pair = replace(sharp, no_flash=no_flash, flash=flash)
    lamps = lamps_of(warm_to_cool[[0, 2]])

    found = separated(pair, lamps)

    np.testing.assert_allclose(found.layers.sum(axis=0), sharp.no_flash, atol=1e-5)
    error = np.square(found.layers - layers).sum() / np.square(layers).sum()
    assert 10 * np.log10(1 / error) > 20
    small = separate_reduced(pair, reduce_pair(pair), lamps).layers.sum(axis=0)
    np.testing.assert_allclose(small, sharp.no_flash, atol=1e-5)


@pytest.mark.parametrize("rows", [16, 1000])
def test_fast_averages_less_noise_and_still_adds_up(
    separated: Callable[..., Strip],
    grainy: Callable[..., Any],
    lamps_of: Any,
    rows: int,
    warm_to_cool: Floats64,
) -> None:
    pair, _ = grainy(2)
    lamps = lamps_of(warm_to_cool[[0, 2]])

    best, balanced, fast = (
        separated(pair, lamps, rows=rows, quality=quality)
        for quality in ("best", "balanced", "fast")
    )

    noises = pair.no_flash_noise, pair.flash_noise
    for strip, rounds in ((fast, 2), (balanced, 3), (best, 4)):
        filtered, _, _ = sigma_filter((pair.no_flash, pair.flash), noises, rounds=rounds)
        np.testing.assert_array_equal(strip.no_flash, filtered)
    np.testing.assert_allclose(fast.layers.sum(axis=0), pair.no_flash, rtol=3e-6, atol=1e-7)


@pytest.mark.parametrize("method", ["best", "paper"])
def test_cancel_stops_between_strips(
    exact: Exact, lamps_of: Callable[..., Any], model: Model, warm_to_cool: Floats64, method: Any
) -> None:
    pair, _ = exact(warm_to_cool[[0, 2]])
    reports: list[float] = []
    progress = Progress(lambda _, part: reports.append(part), lambda: len(reports) == 3)
    lamps = lamps_of(warm_to_cool[[0, 2]])
    options = Options(method=method)
    strips = separate(pair, reduce_pair(pair), lamps, model, options, progress, 8)

    done = [next(strips).rows.stop for _ in range(3)]

    with pytest.raises(Canceled):
        next(strips)
    assert done == [8, 16, 24]
    assert reports == pytest.approx([0, 8 / 64, 16 / 64])


@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize("more", [{}, {"flash_only": True}, {"registration_px": 0.35}], ids=str)
def test_best_is_what_it_is_defined_to_be(
    grainy: Callable[..., Any],
    model: Model,
    separated: Callable[..., Strip],
    lamps_of: Callable[..., Any],
    warm_to_cool: Floats64,
    count: int,
    more: dict[str, Any],
) -> None:
    pair, _ = grainy(count, **more)
    lamps = lamps_of(warm_to_cool if count == 3 else warm_to_cool[[0, 2]][:count])

    found = separated(pair, lamps, rows=13)

    reduced = reduce_pair(pair)
    layers, confidence = definition.separate(pair, reduced, lamps, model.flash_white)
    # where the flash does not reach, rounding decides between lamps, and smoothing spreads it
    reached = (slice(None), slice(20, None), slice(20, None))
    np.testing.assert_allclose(found.layers[reached], layers[reached], atol=3e-6)
    np.testing.assert_allclose(found.confidence, confidence, atol=1e-5)


def test_edges_that_do_not_quite_fit_take_the_shares_beside_them(
    pair_of: Callable[..., Any],
    separated: Callable[..., Strip],
    lamps_of: Callable[..., Any],
    exact: Exact,
    warm_to_cool: Floats64,
) -> None:
    """Even light on a painted step; the flash photograph lies two fifths of a pixel beside it."""
    chosen = warm_to_cool[[0, 2]]
    clean, layers = exact(chosen)
    shape = clean.no_flash.shape
    lit = [clean.no_flash[30, 30], (clean.flash - clean.no_flash)[30, 30]]
    place = np.broadcast_to(np.arange(shape[1]) - shape[1] / 2 + 0.5, shape[:2])

    def painted(shift: float) -> list[Floats64]:
        first = np.clip(place + shift + 0.5, 0, 1)[..., None]
        paint = 0.2 + first * (np.array([1.0, 0.3, 0.5]) - 0.2)
        return [light * paint for light in lit]

    before, part = painted(0.0)[0], painted(0.4)[1]
    lamps, truth = lamps_of(chosen), layers[:, 30, 30] / clean.no_flash[30, 30]

    def worst(registration: float) -> float:
        strip = separated(pair_of(before, part, registration_px=registration), lamps)
        return float(np.abs(strip.layers / before - truth[:, None, None]).max())

    assert worst(0.35) < 0.45 * worst(0.0)


def test_a_reduced_pair_is_separated_about_as_the_pair(
    exact: Exact, lamps_of: Callable[..., Any], warm_to_cool: Floats64
) -> None:
    """Where it is clipped its light is the photograph's, dealt out as around."""
    clipped = np.zeros((64, 96), bool)
    clipped[20:40, 30:60] = True
    pair, layers = exact(warm_to_cool[[0, 2]], unusable=clipped)

    strip = separate_reduced(pair, reduce_pair(pair), lamps_of(warm_to_cool[[0, 2]]))

    np.testing.assert_allclose(strip.layers.sum(axis=0), pair.no_flash, rtol=1e-3, atol=1e-6)
    np.testing.assert_allclose(strip.layers[:, :18], layers[:, :18], rtol=0.05, atol=0.005)
    assert not strip.confidence[clipped].any()
    assert strip.confidence[:18].mean() > 0.9


@pytest.mark.parametrize("rows", [7, 1000])
def test_what_a_lamp_gave_more_with_the_flash_is_no_light_of_the_flash(
    separated: Callable[..., Strip],
    exact: Exact,
    lamps_of: Callable[..., Any],
    warm_to_cool: Floats64,
    rows: int,
) -> None:
    chosen = warm_to_cool[[0, 2]]
    pair, layers = exact(chosen)
    brighter = replace(pair, flash=pair.flash + (0.2 * layers[0]).astype(np.float32))

    found = separated(brighter, lamps_of(chosen, changes=np.array([0.2, 0.0])), rows=rows)

    usual = separated(pair, lamps_of(chosen))
    np.testing.assert_allclose(found.flash, usual.flash, rtol=0.02, atol=1e-4)
    np.testing.assert_allclose(found.layers, usual.layers, rtol=0.05, atol=2e-3)

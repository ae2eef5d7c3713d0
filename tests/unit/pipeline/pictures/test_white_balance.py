from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.hui2018.white_balance import PublishedWhiteBalance
from pipeline.images.frames import Image
from pipeline.light.model import Model
from pipeline.pictures.white_balance import (
    WhiteBalance,
    from_layers,
    neutral_white,
    whites_of,
)
from pipeline.separation.separation import Strip
from pipeline.spectra.cameras import Camera
from pipeline.spectra.lights import find_light, reflectance_spectra
from pipeline.spectra.matrices import best_matrix
from tests.definitions import pixels

Exact = Callable[..., tuple[Any, Floats64]]
Lit = Callable[[Floats64], tuple[Strip, Any]]


def approach_1(strip: Strip, lamps: Any, model: Model, method: str) -> Image:
    found, other = balance_of(method, lamps, model).of(strip, True, False)
    assert found is not None
    assert other is None
    return found


def approach_2(strip: Strip, lamps: Any, model: Model, method: str) -> Image:
    other, found = balance_of(method, lamps, model).of(strip, False, True)
    assert found is not None
    assert other is None
    return found


def balance_of(method: str, lamps: Any, model: Model) -> WhiteBalance | PublishedWhiteBalance:
    if method == "best":
        return WhiteBalance(lamps, model, clipping=1.0)
    return PublishedWhiteBalance(lamps, model)


def strip_of(pair: Any, layers: Floats64, confidence: float = 1.0) -> Strip:
    """The true layers of a pair, as if they had been found."""
    return Strip(
        rows=slice(0, len(pair.unusable)),
        layers=layers.astype(np.float32),
        no_flash=pair.no_flash,
        flash=pair.flash - pair.no_flash,
        confidence=np.full(pair.unusable.shape, confidence, np.float32),
    )


@pytest.fixture
def lit(exact: Exact, lamps_of: Callable[..., Any]) -> Lit:
    """A pair under lamps of these coefficients, as if truly separated, and the lamps."""

    def build(coefficients: Floats64) -> tuple[Strip, Any]:
        return strip_of(*exact(coefficients)), lamps_of(coefficients)

    return build


@pytest.mark.parametrize("count", [1, 2, 3])
def test_approach_1_keeps_the_green_of_every_lamp(
    lit: Lit,
    model: Model,
    shares_of: Callable[[int], Floats64],
    flash_part: Image,
    warm_to_cool: Floats64,
    count: int,
) -> None:
    """Σ_j z_j (g_j / g_n) T_n I_f."""
    strip, lamps = lit(warm_to_cool[:count])
    greens = (lamps.matrices @ model.flash_white)[:, 1]
    neutral = model.flash_to_neutral

    found = approach_1(strip, lamps, model, "best")

    brightness = np.einsum("nhw,n->hw", shares_of(count), greens / (neutral @ model.flash_white)[1])
    expected = brightness[..., None] * (flash_part @ neutral.T)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, expected, atol=2e-5)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_published_approach_1_takes_all_coefficients_for_as_long(
    lit: Lit,
    model: Model,
    shares_of: Callable[[int], Floats64],
    flash_part: Image,
    warm_to_cool: Floats64,
    count: int,
) -> None:
    """Σ_j z_j ‖b_j‖ / ‖b_n‖ T_n I_f, lengths in the published coordinates."""
    strip, lamps = lit(warm_to_cool[:count])
    strengths = _published_lengths(model, warm_to_cool[:count])

    found = approach_1(strip, lamps, model, "paper")

    brightness = np.einsum("nhw,n->hw", shares_of(count), strengths)
    expected = brightness[..., None] * (flash_part @ model.lamp_matrix(model.neutral).T)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, expected, atol=2e-5)


@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize("method", ["paper", "best"])
def test_approach_2_keeps_the_strength_of_all_light(
    lit: Lit,
    model: Model,
    shares_of: Callable[[int], Floats64],
    flash_part: Image,
    warm_to_cool: Floats64,
    count: int,
    method: str,
) -> None:
    """‖β‖ / ‖b_n‖ T_n I_f, with β = Σ_j z_j b_j; as published, in its coordinates.

    Of the most saturated surfaces best believes the equations less than that.
    """
    matrix = model.lamp_matrix(model.neutral) if method == "paper" else model.flash_to_neutral
    strip, lamps = lit(warm_to_cool[:count])
    beta = np.einsum("nhw,nk->hwk", shares_of(count), warm_to_cool[:count])
    strength = np.linalg.norm(beta, axis=2) / np.linalg.norm(model.neutral)
    if method == "paper":
        strength = _published_lengths(model, beta)

    found = approach_2(strip, lamps, model, method)

    expected = strength[..., None] * (flash_part @ matrix.T)
    if method == "paper":
        np.testing.assert_allclose(found, expected, atol=2e-5)
    else:
        off = np.abs(found / expected - 1).max(axis=2)
        assert np.median(off) < 0.01
        assert np.mean(off > 0.1) < 0.1


@pytest.mark.parametrize(
    ("name", "most"), [("A", 1.9), ("FL2", 1.6), ("LED-B1", 1.7), ("LED-RGB1", 2.4)]
)
def test_no_measured_surface_glows_in_approach_2(
    model: Model,
    camera: Camera,
    pair_of: Callable[..., Any],
    lamps_of: Callable[..., Any],
    name: str,
    most: float,
) -> None:
    """All light of a white card's strength; saturated pink ones came to eight times of it."""
    s, lamp, xenon = camera.sensitivities, find_light(name), find_light("xenon")
    white = 0.5 * s @ lamp / (s[1] @ lamp)
    seen = 0.5 * (reflectance_spectra() @ (s * lamp).T / (s[1] @ lamp))[None]
    flash = (reflectance_spectra() @ (s * xenon).T / (s[1] @ xenon))[None]
    strip = strip_of(pair_of(seen, flash), seen[None])
    lit = np.linalg.norm(white) / np.linalg.norm(model.neutral) * flash @ model.flash_to_neutral.T

    found = approach_2(strip, lamps_of(white), model, "best")

    ratio = found.max(axis=2) / lit.max(axis=2)
    assert ratio.max() < most
    assert ratio.min() > 0.65
    assert np.median(np.abs(ratio - 1)) < 0.045


def _published_lengths(model: Model, lights: Floats64) -> Floats64:
    """Lengths of lights (…, 3) over that of neutral light, in the coordinates of Γ."""
    lengths = np.linalg.norm(lights @ model.published.T, axis=-1)
    return np.asarray(lengths / np.linalg.norm(model.published @ model.neutral))


@pytest.mark.parametrize("approach", [approach_1, approach_2])
@pytest.mark.parametrize("method", ["paper", "best"])
def test_under_the_neutral_light_nothing_changes(
    lit: Lit, model: Model, approach: Callable[..., Image], method: str
) -> None:
    strip, lamps = lit(model.neutral / np.linalg.norm(model.neutral))

    found = approach(strip, lamps, model, method)

    # best takes colours from measured surfaces, not from the model
    limit = 1e-5 if method == "paper" else 0.06 * strip.no_flash.max()
    assert np.abs(found - strip.no_flash).max() < limit


@pytest.mark.parametrize("approach", [approach_1, approach_2])
@pytest.mark.parametrize("confidence", [0.0, 0.5, 1.0])
def test_white_surfaces_become_neutral_under_any_lamps(
    model: Model,
    camera: Camera,
    pair_of: Callable[..., Any],
    lamps_of: Callable[..., Any],
    warm_to_cool: Floats64,
    approach: Callable[..., Image],
    confidence: float,
) -> None:
    """The channels' ratios are those of a measured white card in daylight."""
    lamps = lamps_of(warm_to_cool)
    z = np.random.default_rng(1).uniform(0, 0.5, (3, 20, 30, 1))
    white = model.flash_white * 0.8
    layers = z * (lamps.matrices @ white)[:, None, None]
    pair = pair_of(layers.sum(axis=0), np.tile(white, (20, 30, 1)))

    found = approach(strip_of(pair, layers, confidence), lamps, model, "best")

    daylight = camera.sensitivities @ find_light("D65")
    ratio = found / found[..., 1:2] / (daylight / daylight[1])
    np.testing.assert_allclose(ratio, 1, atol=0.01)


@pytest.mark.parametrize("approach", [approach_1, approach_2])
@pytest.mark.parametrize(("name", "most"), [("A", 2.0), ("D50", 0.6), ("FL2", 2.5)])
def test_filled_in_pixels_take_their_colour_from_the_layers(
    model: Model,
    camera: Camera,
    pair_of: Callable[..., Any],
    lamps_of: Callable[..., Any],
    approach: Callable[..., Image],
    name: str,
    most: float,
) -> None:
    """Without any flash part: measured surfaces as in daylight, better than by scaled channels."""
    s, lamp, daylight = camera.sensitivities, find_light(name), find_light("D65")
    seen = (reflectance_spectra() @ (s * lamp).T / (s[1] @ lamp))[None]
    wanted = (reflectance_spectra() @ (s * daylight).T / (s[1] @ daylight))[None]
    white, neutral = s @ lamp / (s[1] @ lamp), s @ daylight / (s[1] @ daylight)
    lamps = lamps_of(white, matrices=best_matrix(s * find_light("xenon"), s * lamp)[None])
    pair = pair_of(0.5 * seen, np.zeros_like(seen))

    found = approach(strip_of(pair, 0.5 * seen[None], 0.0), lamps, model, "best")

    def degrees(colours: Any) -> float:
        across = np.linalg.norm(np.cross(colours, wanted), axis=2)
        return float(np.degrees(np.arctan2(across, (colours * wanted).sum(axis=2))).mean())

    assert degrees(found) < most
    assert degrees(found) < degrees(seen * neutral / white)
    assert found[..., 1].mean() == pytest.approx(0.5 * wanted[..., 1].mean(), rel=0.03)


@pytest.mark.parametrize("approach", [approach_1, approach_2])
@pytest.mark.parametrize(
    ("colour", "whitened"),
    [
        ((1.0, 1.0, 1.0), 1.0),
        ((1.0, 1.0, 0.4), 1.0),
        ((1.0, 0.99, 0.85), 1.0),
        ((0.2, 0.99, 1.0), 0.0),
        ((1.0, 0.945, 0.4), 0.5),
        ((1.0, 0.945, 0.1), 0.0),
        ((1.0, 0.7, 0.3), 0.0),
        ((0.89, 0.89, 0.89), 0.0),
    ],
)
def test_clipped_highlights_become_white(
    model: Model,
    pair_of: Callable[..., Any],
    lamps_of: Callable[..., Any],
    warm_to_cool: Floats64,
    approach: Callable[..., Image],
    colour: tuple[float, float, float],
    whitened: float,
) -> None:
    """Nothing is separated there. One clipped channel keeps its hue; two, if a third tells it."""
    lamps = lamps_of(warm_to_cool[0])

    def balanced(light: float) -> Any:
        photograph = light * np.tile(colour, (6, 7, 1))
        pair = pair_of(photograph, np.zeros((6, 7, 3)))
        return approach(strip_of(pair, photograph[None], 0.0), lamps, model, "best")[3, 3] / light

    found = balanced(1.0)

    white = model.flash_to_neutral @ model.flash_white
    white /= white[1]
    gained = balanced(0.5)
    expected = (1 - whitened) * gained + whitened * (gained / white).max() * white
    np.testing.assert_allclose(found, expected, rtol=1e-4)


@pytest.mark.parametrize("approach", [approach_1, approach_2])
@pytest.mark.parametrize(("light", "clipped"), [(1.0, 1.0), (0.945, 0.5), (0.9, 0.0)])
def test_a_channel_that_alone_is_clipped_is_not_the_least_of_all(
    model: Model,
    pair_of: Callable[..., Any],
    lamps_of: Callable[..., Any],
    camera: Camera,
    approach: Callable[..., Image],
    light: float,
    clipped: float,
) -> None:
    """As it was brighter, it is as the next one is: bright white things have no coloured rims."""
    s, greenish = camera.sensitivities, find_light("FL2")
    lamps = lamps_of(
        s @ greenish, matrices=best_matrix(s * find_light("xenon"), s * greenish)[None]
    )
    colour = lamps.matrices[0] @ model.flash_white * (1.0, 0.9, 1.0)
    colour *= light / colour.max()
    assert colour[1] == light
    assert np.median(colour) < 0.9  # not clipped in two channels
    photograph = np.tile(colour, (6, 7, 1))
    pair = pair_of(photograph, np.zeros((6, 7, 3)))

    found = approach(strip_of(pair, photograph[None], 0.0), lamps, model, "best")[3, 3]

    neutral = from_layers(lamps, model)[0] @ colour / neutral_white(model)
    expected = neutral.copy()
    expected[1] += clipped * (neutral[[0, 2]].min() - neutral[1])
    assert neutral.argmin() == 1
    np.testing.assert_allclose(found / neutral_white(model), expected, rtol=1e-4)


def test_where_nothing_is_clipped_highlights_keep_their_colour(
    model: Model,
    pair_of: Callable[..., Any],
    lamps_of: Callable[..., Any],
    warm_to_cool: Floats64,
) -> None:
    """As in float files that go on above 1: brighter by ten, it is ten times the same."""
    lamps = lamps_of(warm_to_cool[0])
    balance = WhiteBalance(lamps, model, clipping=np.inf)

    def balanced(light: float) -> Any:
        photograph = light * np.tile((1.0, 0.9, 0.4), (6, 7, 1))
        pair = pair_of(photograph, np.zeros((6, 7, 3)))
        return balance.of(strip_of(pair, photograph[None], 0.0), True, True)

    for bright, dark in zip(balanced(5.0), balanced(0.5), strict=True):
        np.testing.assert_allclose(bright, 10 * dark, rtol=1e-5)


@pytest.mark.parametrize("approach", [approach_1, approach_2])
def test_paper_leaves_highlights_as_they_are(
    lit: Lit, model: Model, warm_to_cool: Floats64, approach: Callable[..., Image]
) -> None:
    strip, lamps = lit(warm_to_cool)
    plain = approach(strip, lamps, model, "paper")
    strip.layers[...] *= 10  # of the photograph's values, not of what paper makes of them
    scaled = approach(strip, lamps, model, "paper")

    factor = 10 if approach is approach_1 else 1
    np.testing.assert_allclose(scaled, factor * plain, rtol=1e-3, atol=1e-5)


@pytest.mark.parametrize("approach", [approach_1, approach_2])
def test_a_lamp_without_blue_does_not_make_filled_in_pixels_glow(
    lit: Lit, model: Model, warm_to_cool: Floats64, approach: Callable[..., Image]
) -> None:
    """The least blue a lamp is taken to have is a fiftieth of its strongest channel."""
    strip, lamps = lit(warm_to_cool[:1])
    strip.confidence[...] = 0
    lamps.matrices[:, 2] = 0
    strongest = (lamps.matrices[0] @ model.flash_white).max()
    green = (lamps.matrices[0] @ model.flash_white)[1]

    found = approach(strip, lamps, model, "best")

    white = model.flash_to_neutral @ model.flash_white
    gain = white[2] / white[1] / (0.02 * strongest / green)
    np.testing.assert_allclose(found[..., 2], gain * strip.layers[0, ..., 2], rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("approach", [approach_1, approach_2])
def test_a_lamp_that_shines_less_than_nothing_in_blue_counts_by_its_strongest_channel(
    lit: Lit, model: Model, warm_to_cool: Floats64, approach: Callable[..., Image]
) -> None:
    strip, lamps = lit(warm_to_cool[:1])
    strip.confidence[...] = 0
    lamps.matrices[0] = np.diag(np.array([1.0, 0.8, -2.0]) / model.flash_white)

    found = approach(strip, lamps, model, "best")

    white = model.flash_to_neutral @ model.flash_white
    gain = white[2] / white[1] / (0.02 * 2.0 / 0.8)
    np.testing.assert_allclose(found[..., 2], gain * strip.layers[0, ..., 2], rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("approach", [approach_1, approach_2])
def test_between_a_colour_and_none_a_lamp_is_believed_by_half(
    lit: Lit, model: Model, warm_to_cool: Floats64, approach: Callable[..., Image]
) -> None:
    """How much green is made of blue grows as blue is fainter, and goes where there is too little.

    Of the strongest channel blue has a fifth, 0.13 and 0.06.
    """
    made = []
    for blue in (0.2, 0.13, 0.06):
        strip, lamps = lit(warm_to_cool[:1])
        strip.confidence[...] = 0
        strip.layers[...] = [0, 0, 0.05]
        lamps.matrices[0] = np.diag(np.array([1.0, 0.8, blue]) / model.flash_white)
        made.append(approach(strip, lamps, model, "best")[3, 3, 1])

    assert made[0] > 0.02
    assert made[1] / made[0] == pytest.approx(0.5 * 0.2 / 0.13, rel=0.1)
    assert made[2] == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize("flash", [(0.4, 1e-6, 1e-6), (1e-42, 2e-42, 1e-42)])
def test_no_pixel_of_approach_2_gets_far_brighter_than_the_photograph(
    lit: Lit, model: Model, warm_to_cool: Floats64, flash: tuple[float, ...]
) -> None:
    """Colours of which the flash part holds next to nothing ask for any amount of light."""
    strip, lamps = lit(warm_to_cool[[0, 2]])
    strip.flash[...] = np.array(flash)

    found = approach_2(strip, lamps, model, "best")

    peak = found.max(axis=2) / strip.no_flash.max(axis=2)
    assert peak.max() <= 4.001


def test_published_approach_2_takes_a_flash_of_one_channel_for_what_it_is(
    lit: Lit, model: Model, warm_to_cool: Floats64
) -> None:
    """‖β‖/‖b_n‖ T_n I_f, with β from I_nf = Σ_j β_j D_j I_f, however bright that becomes."""
    strip, lamps = lit(warm_to_cool[[0, 2]])
    flash = np.array([0.4, 1e-6, 1e-6])
    strip.flash[...] = flash
    columns = np.stack([model.tensor[:, :, j] @ flash for j in range(3)], axis=1)
    beta = strip.no_flash.astype(np.float64) @ np.linalg.inv(columns).T
    strength = _published_lengths(model, beta)
    neutral = np.maximum(model.lamp_matrix(model.neutral) @ flash, 0)

    found = approach_2(strip, lamps, model, "paper")

    np.testing.assert_allclose(found, strength[..., None] * neutral, rtol=1e-3, atol=1e-6)


@pytest.mark.parametrize("approach", [approach_1, approach_2])
@pytest.mark.parametrize("method", ["paper", "best"])
@pytest.mark.parametrize("value", [0.0, -0.01, 1e-9])
@pytest.mark.parametrize("confidence", [1.0, 0.0])
def test_dark_pixels_stay_finite_and_not_negative(
    pair_of: Callable[..., Any],
    model: Model,
    lamps_of: Callable[..., Any],
    warm_to_cool: Floats64,
    approach: Callable[..., Image],
    method: str,
    value: float,
    confidence: float,
) -> None:
    dark = np.full((4, 6, 3), value)
    strip = strip_of(pair_of(dark, dark), np.stack([dark / 3] * 3), confidence)

    found = approach(strip, lamps_of(warm_to_cool), model, method)

    assert np.isfinite(found).all()
    assert (found >= 0).all()


@pytest.mark.parametrize("method", ["paper", "best"])
def test_both_approaches_at_once_are_what_they_are_alone(
    lit: Lit, model: Model, warm_to_cool: Floats64, method: str
) -> None:
    strip, lamps = lit(warm_to_cool)
    strip.confidence[10:20] = 0.3
    balance = balance_of(method, lamps, model)

    found = balance.of(strip, True, True)

    for one, alone in zip(found, (approach_1, approach_2), strict=True):
        assert one is not None
        np.testing.assert_array_equal(one, alone(strip, lamps, model, method))
    assert balance.of(strip, False, False) == (None, None)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_approaches_are_what_they_are_defined_to_be(
    lit: Lit, model: Model, warm_to_cool: Floats64, count: int
) -> None:
    """With noise, negative values, and a flash that does not reach everywhere."""
    strip, lamps = lit(warm_to_cool[:count])
    rng = np.random.default_rng(3)
    for values in (strip.layers, strip.flash, strip.no_flash):
        values += rng.normal(0, 0.01, values.shape)
    strip.flash[30:40, 20:50] = 0
    matrix = model.flash_to_neutral
    greens = whites_of(lamps, model)[:, 1] / (matrix @ model.flash_white)[1]

    found = [approach(strip, lamps, model, "best") for approach in (approach_1, approach_2)]

    defined = (
        pixels.approach_1(strip, lamps, greens, matrix),
        pixels.approach_2(strip, model, matrix),
    )
    np.testing.assert_allclose(found[0], defined[0], rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(found[1], defined[1], rtol=1e-3, atol=1e-6)


@pytest.mark.parametrize("approach", [approach_1, approach_2])
def test_confidence_is_the_share_of_the_flash_photograph(
    lit: Lit, model: Model, warm_to_cool: Floats64, approach: Callable[..., Image]
) -> None:
    strip, lamps = lit(warm_to_cool)
    trust = np.random.default_rng(2).uniform(0, 1, strip.confidence.shape).astype(np.float32)
    strip.layers[...] *= 0.8 / strip.layers.sum(axis=0).max()  # nothing clipped
    made = []
    for confidence in (np.float32(1), np.float32(0), trust):
        strip.confidence[...] = confidence
        made.append(approach(strip, lamps, model, "best"))

    share = trust[..., None]
    np.testing.assert_allclose(made[2], share * made[0] + (1 - share) * made[1], atol=1e-6)

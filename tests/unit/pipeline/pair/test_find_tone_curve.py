"""Shadows of two lamps and a flash without edges on patches of paint, through curves."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.colour.curves import linear_to_srgb, srgb_to_linear
from pipeline.images.coded import TableImage
from pipeline.images.frames import Mask
from pipeline.pair.find_tone_curve import find_tone_curve
from pipeline.pair.tone_curve import ToneCurve

Curve = Callable[[Floats64], Floats64]

SIZE = 288, 216
PATCH = 24
S, STRONGER = 0.05, 0.08


def s_curve(strength: float) -> Curve:
    """Code values moved away from the middle."""
    return lambda codes: codes - strength * np.sin(2 * np.pi * codes)


def brighter(codes: Floats64) -> Floats64:
    """Middle tones brighter, highlights flatter."""
    return np.asarray(1 - (1 - codes) ** 1.5)


def light_of(
    shadows: Literal["slanted", "upright", "level", "none"] = "slanted", flash: float = 0.35
) -> tuple[Floats64, Floats64]:
    """Light (H, W, 3) without and with a flash. shadows: how their edges run."""
    random = np.random.default_rng(3)
    width, height = SIZE
    paints = random.uniform(0.25, 0.95, (height // PATCH, width // PATCH, 3))
    paint = np.kron(paints, np.ones((PATCH, PATCH, 1)))
    y, x = np.mgrid[:height, :width]
    first, second = np.ones((2, height, width))
    if shadows != "none":
        along, across = {
            "slanted": (x + y // 2, y + x // 3),
            "upright": (x, x + 15),
            "level": (y, y + 15),
        }[shadows]
        first = np.where(along % 66 < 30, 0.05, 1.0)
        second = np.where(across % 78 < 36, 0.05, 1.0)
    lamps = first[..., None] * [0.3, 0.22, 0.12] + second[..., None] * [0.1, 0.16, 0.25]
    even = flash * (1 - 0.3 * ((x - 140) ** 2 + (y - 100) ** 2) / 3e4)[..., None]
    return paint * (lamps + 0.02), paint * (lamps + 0.02 + even)


def photographs(curve: Curve, light: tuple[Floats64, Floats64]) -> tuple[TableImage, TableImage]:
    """What a camera with this curve on top of sRGB's makes of light, in 8 bits."""
    table = srgb_to_linear(np.arange(256, dtype=np.float32) / 255)

    def coded(one: Floats64) -> TableImage:
        codes = curve(linear_to_srgb(np.clip(one, 0.0, 1.0)).astype(np.float64))
        return TableImage(np.round(255 * codes).astype(np.uint8), table)

    return coded(light[0]), coded(light[1])


def nothing() -> Mask:
    """A mask of pixels that cannot be used, empty."""
    return np.zeros(SIZE[::-1], np.bool_)


def off(found: ToneCurve, curve: Curve) -> float:
    """Root mean square of code values that the light found has and the true one."""
    codes = np.linspace(0.15, 0.95, 81)
    seen = srgb_to_linear(curve(codes)).astype(np.float32)
    return float(np.sqrt(np.mean((linear_to_srgb(found.light(seen)) - codes) ** 2)))


@pytest.mark.parametrize(
    ("curve", "most"), [(s_curve(S), 0.015), (s_curve(STRONGER), 0.01), (brighter, 0.035)]
)
def test_a_contrast_is_found(curve: Curve, most: float) -> None:
    found = find_tone_curve(*photographs(curve, light_of()), nothing(), 1.0)

    assert found is not None
    assert off(found, curve) < most
    nothing_taken_off = ToneCurve(np.zeros(11))
    assert off(found, curve) < 0.4 * off(nothing_taken_off, curve)


@pytest.mark.parametrize("shadows", ["upright", "level"])
def test_edges_that_run_one_way_tell_it(shadows: Literal["upright", "level"]) -> None:
    found = find_tone_curve(*photographs(s_curve(S), light_of(shadows)), nothing(), 1.0)

    assert found is not None
    assert off(found, s_curve(S)) < 0.02


def test_a_few_edges_are_not_enough() -> None:
    no_flash, flash = (one[:24, :72] for one in light_of("upright"))

    assert (
        find_tone_curve(*photographs(s_curve(S), (no_flash, flash)), nothing()[:24, :72], 1.0)
        is None
    )


def test_the_curve_of_srgb_alone_stays() -> None:
    assert find_tone_curve(*photographs(lambda codes: codes, light_of()), nothing(), 1.0) is None


def test_without_shadows_nothing_tells_the_curve() -> None:
    pair = photographs(s_curve(S), light_of("none"))

    assert find_tone_curve(*pair, nothing(), 1.0) is None


def test_a_flash_that_hardly_reaches_tells_nothing() -> None:
    pair = photographs(s_curve(S), light_of(flash=0.005))

    assert find_tone_curve(*pair, nothing(), 1.0) is None


def test_the_ratio_of_exposures_is_taken_off_the_light_not_the_codes() -> None:
    no_flash, flash = light_of()
    pair = photographs(s_curve(S), (no_flash, 0.5 * flash))

    found = find_tone_curve(*pair, nothing(), 0.5)

    assert found is not None
    assert off(found, s_curve(S)) < 0.016


def test_what_cannot_be_used_does_not_count() -> None:
    """In the right half the flash photograph shows something else."""
    no_flash, flash = photographs(s_curve(S), light_of())
    other = flash[:].copy()
    half = SIZE[0] // 2
    other[:, half:] = np.roll(other[:, half:], 17, axis=0)
    unusable = nothing()
    unusable[:, half:] = True

    found = find_tone_curve(no_flash, other, unusable, 1.0)

    assert found is not None
    assert off(found, s_curve(S)) < 0.016


def test_all_that_cannot_be_used_tells_nothing() -> None:
    pair = photographs(s_curve(S), light_of())

    assert find_tone_curve(*pair, ~nothing(), 1.0) is None


def test_a_picture_smaller_than_a_step_tells_nothing() -> None:
    no_flash, flash = (np.full((6, 7, 3), light, np.float32) for light in (0.2, 0.4))

    assert find_tone_curve(no_flash, flash, np.zeros((6, 7), np.bool_), 1.0) is None

"""Shadows of two lamps on paint, written through curves or not, and read as linear values."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.colour.curves import linear_to_srgb
from pipeline.pair import find_encoding
from pipeline.pair.find_encoding import looks_encoded
from pipeline.pair.find_exposure_ratio import find_exposure_ratio
from pipeline.pair.ratios import Ratios
from tests.unit.pipeline.pair.ratios_of_scenes import ratios_of
from tests.unit.pipeline.pair.shadows_on_paint import Curve, light_of, s_curve


def srgb(light: Floats64) -> Floats64:
    return linear_to_srgb(np.clip(light, 0.0, 1.0)).astype(np.float64)


def rec709(light: Floats64) -> Floats64:
    """Rec. ITU-R BT.709, as some converters write it by default."""
    return np.where(light < 0.018, 4.5 * light, 1.099 * light**0.45 - 0.099)


def heights_of(ratios: Ratios, linear: float, encoded: float) -> Callable[..., float]:
    """Heights of a pair as it was read, and of the same through any curve."""
    return lambda read, *_: linear if read is ratios else encoded


def written(curve: Curve, brighter: float = 1.0) -> Ratios:
    """The pair through a curve, by so much brighter light."""
    without, flash = light_of()
    return ratios_of(curve(without * brighter), curve(flash * brighter))


@pytest.mark.parametrize(
    "curve",
    [
        srgb,
        rec709,
        lambda light: light ** (1 / 2.2),
        lambda light: s_curve(0.05)(srgb(light)),
    ],
    ids=["srgb", "rec709", "gamma", "s-curve"],
)
def test_values_that_follow_a_curve_are_told(curve: Curve) -> None:
    assert looks_encoded(written(curve), 1.0)


@pytest.mark.parametrize("brighter", [0.125, 0.25, 0.5, 1.0])
def test_linear_values_are_not(brighter: float) -> None:
    ratios = written(lambda light: light, brighter)

    assert find_exposure_ratio(ratios) == 1.0
    assert not looks_encoded(ratios, 1.0)


@pytest.mark.parametrize("factor", [0.25, 0.5, 2.0, 4.0])
def test_nor_linear_values_on_the_scale_of_a_wrong_ratio(factor: float) -> None:
    right = written(lambda light: light)

    assert not looks_encoded(replace(right, logs=right.logs - np.log(factor)), 1.0)


def test_a_ratio_that_was_told_is_brought_back_before_values_are_read_through_a_curve() -> None:
    without, flash = light_of()
    ratios = ratios_of(srgb(without), srgb(flash / 2) * 2)

    assert looks_encoded(ratios, 0.5)


@pytest.mark.parametrize(("median", "expected"), [(0.101, True), (0.099, False)])
def test_pictures_must_be_as_bright_as_a_tenth(
    median: float, expected: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the dark sRGB's curve is a line, and linear values pass for encoded ones."""
    ratios = written(srgb)
    monkeypatch.setattr(find_encoding, "_height", heights_of(ratios, 0.0, 9.0))
    flash = ratios.no_flash * np.exp(ratios.logs)
    darker = replace(ratios, no_flash=ratios.no_flash * median / np.median(flash[ratios.usable]))

    assert looks_encoded(darker, 1.0) is expected


@pytest.mark.parametrize(
    ("linear", "encoded", "expected"),
    [(0.0, 2.01, True), (0.0, 1.99, False), (10.0, 6.01, True), (10.0, 5.99, False)],
)
def test_how_high_the_peak_must_be(
    linear: float, encoded: float, expected: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    ratios = written(srgb)
    monkeypatch.setattr(find_encoding, "_height", heights_of(ratios, linear, encoded))

    assert looks_encoded(ratios, 1.0) is expected


def test_where_linear_values_have_the_ratio_that_was_told_nothing_is_asked(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(find_encoding, "find_exposure_ratio", lambda _: 1.0)

    assert not looks_encoded(written(srgb), 1.0)


def test_a_pair_that_tells_nothing_is_linear() -> None:
    ratios = written(srgb)

    assert not looks_encoded(replace(ratios, usable=np.zeros_like(ratios.usable)), 1.0)

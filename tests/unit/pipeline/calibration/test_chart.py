from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from pipeline.calibration import chart as chart_module
from pipeline.calibration.chart import read_card, read_chart
from pipeline.errors import OptionError, UnusablePairError
from pipeline.images.noise import Noise
from pipeline.options import Circle
from pipeline.pair.pair import Pair
from pipeline.spectra.colorchecker import colorchecker_spectra
from pipeline.spectra.lights import find_light
from tests.evaluation.spectra import sensitivities
from tests.targets import CORNERS, SIZE, Shot, photograph_chart

S, XENON, LAMP = sensitivities("Nikon D5100"), find_light("xenon"), find_light("A")
GRID = np.arange(24).reshape(4, 6)


@pytest.fixture(scope="module")
def chart(pair_of: Callable[..., Pair]) -> Pair:
    return pair_of(photograph_chart(S, XENON, LAMP, colorchecker_spectra()))


def test_patches_have_the_colours_of_their_reflectances(chart: Pair) -> None:
    patches = read_chart(chart, CORNERS)
    true = colorchecker_spectra() @ (S * XENON).T
    colours, wanted = (x / x.sum(axis=1, keepdims=True) for x in (patches.flash, true))
    assert colours == pytest.approx(wanted, abs=1e-5)
    assert patches.places[[0, 5, 18, 23]] == pytest.approx(
        np.array([[-1, -0.6], [1, -0.6], [-1, 0.6], [1, 0.6]])
    )
    # brightest at the upper left, as the flash falls off
    brightness = patches.flash.sum(axis=1) / true.sum(axis=1)
    assert brightness.max() / brightness.min() == pytest.approx(1.295, abs=0.01)


def test_patches_are_read_about_their_middles_and_in_their_inner_half(
    pair_of: Callable[..., Pair], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a picture whose light is its place."""
    monkeypatch.setattr(chart_module, "_check_order", lambda _: None)
    x, y = np.meshgrid(np.arange(SIZE[0]) + 0.5, np.arange(SIZE[1]) + 0.5)
    places = np.stack([x, y, np.ones_like(x)], axis=2)
    one, none = Noise(np.zeros(3), np.ones(3)), Noise(np.zeros(3), np.zeros(3))
    shot = Shot((np.zeros_like(places), 1000 * places), (b"", b""))
    corners = ((60.3, 50.2), (299.8, 50.2), (299.8, 192.1), (60.3, 192.1))
    found = read_chart(pair_of(shot, no_flash_noise=none, flash_noise=one), corners)
    columns, rows = np.meshgrid(60.3 + 47.9 * np.arange(6), 50.2 + 47.3 * np.arange(4))
    off = found.flash[:, :2] / 1000 - np.stack([columns.ravel(), rows.ravel()], axis=1)
    assert np.abs(off).max() < 0.5
    assert off.mean(axis=0) == pytest.approx(0.0, abs=0.15)
    assert 1 / found.variance == pytest.approx(24 * 24, rel=0.1)


@pytest.mark.parametrize(
    ("order", "words"),
    [
        (GRID[::-1, ::-1], "looks like black's, white's, dark skin's, bluish green's"),
        (GRID[:, ::-1], "looks like bluish green's, dark skin's, white's, black's"),
        (GRID[::-1], "looks like white's, black's, bluish green's, dark skin's"),
    ],
)
def test_a_turned_or_mirrored_chart_is_refused(
    pair_of: Callable[..., Pair],
    order: np.ndarray,
    words: str,
) -> None:
    turned = tuple(int(i) for i in order.ravel())
    pair = pair_of(photograph_chart(S, XENON, LAMP, colorchecker_spectra(), order=turned))
    with pytest.raises(OptionError, match=words):
        read_chart(pair, CORNERS)


def test_marks_in_another_order_are_refused(chart: Pair) -> None:
    with pytest.raises(OptionError, match="turned or mirrored"):
        read_chart(chart, CORNERS[2:] + CORNERS[:2])


def test_no_chart_is_refused(pair_of: Callable[..., Pair]) -> None:
    random = np.random.default_rng(3)
    shuffled = tuple(int(i) for i in random.permutation(24))
    pair = pair_of(photograph_chart(S, XENON, LAMP, colorchecker_spectra(), order=shuffled))
    with pytest.raises(OptionError, match="does not look like a ColorChecker"):
        read_chart(pair, CORNERS)


@pytest.mark.parametrize(("left", "refused"), [(0.8, False), (0.2, True)])
def test_a_chart_partly_in_shadow_is_no_mark_that_is_wrong(
    pair_of: Callable[..., Pair], left: float, refused: bool
) -> None:
    """Of the flash so much is left on the right half."""
    shot = photograph_chart(S, XENON, LAMP, colorchecker_spectra(), noise=1.0)
    lamps, both = shot.frames
    share = np.where(np.arange(SIZE[0]) > 180, left, 1.0)[:, None]
    pair = pair_of(Shot((lamps, lamps + share * (both - lamps)), shot.files))
    if refused:
        with pytest.raises(UnusablePairError, match="tints of a ColorChecker, but not its bright"):
            read_chart(pair, CORNERS)
    else:
        assert len(read_chart(pair, CORNERS).flash) == 24


def test_corners_must_lie_inside_and_around(chart: Pair) -> None:
    with pytest.raises(OptionError, match="not all inside the photograph of 360 × 240"):
        read_chart(chart, ((-1.0, 5.0), *CORNERS[1:]))
    with pytest.raises(OptionError, match="cross each other"):
        read_chart(chart, (CORNERS[0], CORNERS[2], CORNERS[1], CORNERS[3]))
    tiny = tuple((100 + x / 60, 100 + y / 60) for x, y in CORNERS)
    with pytest.raises(OptionError, match="covers hardly a pixel"):
        read_chart(chart, tiny)


def test_clipped_and_unlit_patches_are_named(pair_of: Callable[..., Pair]) -> None:
    shot = photograph_chart(S, XENON, LAMP, colorchecker_spectra(), noise=1.0)
    clipped = np.zeros((SIZE[1], SIZE[0]), bool)
    clipped[170:200, 50:90] = True
    with pytest.raises(UnusablePairError, match="Patch 19 of the chart is clipped"):
        read_chart(pair_of(shot, unusable=clipped), CORNERS)
    dark = pair_of(shot, flash=shot.frames[0].astype(np.float32))
    with pytest.raises(UnusablePairError, match="flash does not reach patch 1 of the chart"):
        read_chart(dark, CORNERS)


def test_a_card_is_one_patch_of_flat_reflectance(chart: Pair) -> None:
    card = read_card(chart, Circle(x=14, y=120, radius=12))
    assert (card.flash.shape, card.reflectances.shape) == ((1, 3), (1, 81))
    white = S @ XENON
    assert card.flash[0] / card.flash[0].sum() == pytest.approx(white / white.sum(), abs=1e-5)
    assert (card.reflectances == 1).all()


def test_a_card_has_the_noise_of_its_pixels(pair_of: Callable[..., Pair]) -> None:
    shot = photograph_chart(S, XENON, LAMP, colorchecker_spectra())
    one, other = Noise(np.zeros(3), np.full(3, 1e-6)), Noise(np.zeros(3), np.full(3, 2e-6))
    card = read_card(
        pair_of(shot, no_flash_noise=one, flash_noise=other), Circle(x=14, y=120, radius=12)
    )
    assert card.variance[0] == pytest.approx(3e-6 / (np.pi * 144), rel=0.02)


def test_a_card_is_one_even_surface(chart: Pair) -> None:
    with pytest.raises(OptionError, match="mark of the grey card shows more than one even surface"):
        read_card(chart, Circle(x=75, y=120, radius=40))

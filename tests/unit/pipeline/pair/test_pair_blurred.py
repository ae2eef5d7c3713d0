"""Pairs of which one photograph is less sharp than the other."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pipeline.images.frames import Frame
from pipeline.pair.estimate_noise import estimate_noises
from pipeline.pair.ratios import Ratios
from pipeline.pair.relative_blur import RelativeBlur, blurred
from pipeline.run_warnings import Code
from tests.unit.pipeline.pair.pairs_of_frames import lay_as_they_are, paired

COVARIANCE = np.array([[2.0, 0.5], [0.5, 1.0]])
NONE = np.zeros((2, 2))
SHAKEN = RelativeBlur(COVARIANCE, NONE, np.array([1.2, -0.4]))
SOFT = RelativeBlur(NONE, COVARIANCE, np.zeros(2))


@pytest.fixture
def found(monkeypatch: pytest.MonkeyPatch) -> Callable[[RelativeBlur], list[Ratios]]:
    """Have a blur be found from now on; what it was looked for in."""

    def find(blur: RelativeBlur) -> list[Ratios]:
        given: list[Ratios] = []

        def search(ratios: Ratios, _: Any) -> RelativeBlur:
            given.append(ratios)
            return blur

        monkeypatch.setattr("pipeline.pair.pair.find_relative_blur", search)
        return given

    return find


@pytest.mark.parametrize("laid", [False, True])
@pytest.mark.parametrize("scale", [1.0, 0.5])
def test_the_flash_photograph_is_blurred_as_much_as_the_other(
    frames: Callable[..., tuple[Frame, Frame]],
    found: Callable[[RelativeBlur], list[Ratios]],
    monkeypatch: pytest.MonkeyPatch,
    scale: float,
    laid: bool,
) -> None:
    """Also one that was laid on the other, in memory of its own."""
    before, after = frames(scale=scale)
    seen = after.pixels[:].copy()
    given = found(SHAKEN)
    if laid:
        lay_as_they_are(monkeypatch)

    pair = paired((before, after), exposure_ratio=scale, align=laid)

    expected = blurred(seen / np.float32(scale), SHAKEN.for_flash)
    np.testing.assert_allclose(pair.flash[:], expected, atol=1e-6)
    assert pair.no_flash is pair.photograph is before.pixels
    np.testing.assert_array_equal(after.pixels[:], seen)
    np.testing.assert_allclose(
        np.median(np.exp(given[0].logs)), np.median(seen / scale / before.pixels[:]), rtol=0.05
    )
    assert [one.code for one in pair.warnings] == [Code.BLURRED]


def test_noise_of_a_blurred_photograph_is_less_and_hangs_together(
    frames: Callable[..., tuple[Frame, Frame]], found: Callable[[RelativeBlur], list[Ratios]]
) -> None:
    before, after = frames()
    found(SHAKEN)

    pair = paired((before, after), align=False)

    sharp = estimate_noises(after.pixels, before.pixels)[0]
    left = float(np.square(SHAKEN.for_flash).sum())
    level = np.full(3, 0.2)
    np.testing.assert_allclose(pair.flash_noise.variance(level), left * sharp.variance(level))
    assert pair.flash_noise.grain == pytest.approx(sharp.grain / left)


def test_light_that_unusable_pixels_were_blurred_into_is_unusable(
    frames: Callable[..., tuple[Frame, Frame]], found: Callable[[RelativeBlur], list[Ratios]]
) -> None:
    before, after = frames()
    saturated = np.zeros_like(after.saturated)
    saturated[20:30, 20:30] = True
    after = replace(after, saturated=saturated)
    found(SHAKEN)

    unusable = paired((before, after), align=False).unusable

    assert unusable[20:30, 20:30].all()
    assert unusable[25, 17:31].all()
    assert unusable.sum() < 16 * 16


def test_the_other_is_blurred_as_much_as_a_flash_photograph_that_is_less_sharp(
    frames: Callable[..., tuple[Frame, Frame]], found: Callable[[RelativeBlur], list[Ratios]]
) -> None:
    """What layers add up to stays as sharp as it is."""
    before, after = frames()
    seen = before.pixels[:].copy()
    saturated = np.zeros_like(before.saturated)
    saturated[20:30, 20:30] = True
    before = replace(before, saturated=saturated)
    found(SOFT)

    pair = paired((before, after), align=False)

    np.testing.assert_allclose(pair.no_flash[:], blurred(seen, SOFT.for_no_flash), atol=1e-6)
    assert pair.photograph is before.pixels
    np.testing.assert_array_equal(pair.photograph[:], seen)
    np.testing.assert_array_equal(pair.flash[:], after.pixels[:])
    assert pair.unusable[20:30, 20:30].all()
    assert pair.unusable[25, 18:32].all()
    assert pair.unusable.sum() < 16 * 16
    sharp = estimate_noises(before.pixels, after.pixels)[0]
    left, level = float(np.square(SOFT.for_no_flash).sum()), np.full(3, 0.2)
    np.testing.assert_allclose(
        pair.no_flash_noise.variance(level), left * sharp.variance(level), rtol=0.1
    )
    (warning,) = pair.warnings
    assert warning.code == Code.BLURRED
    assert warning.figures == {"flash_px": pytest.approx(np.sqrt(2.207), abs=1e-3)}


def test_of_a_flash_part_alone_no_blur_is_looked_for(
    frames: Callable[..., tuple[Frame, Frame]], found: Callable[[RelativeBlur], list[Any]]
) -> None:
    before, after = frames()
    given = found(SHAKEN)

    pair = paired((before, after), align=False, flash_only=True)

    assert given == []
    np.testing.assert_array_equal(pair.flash[:], after.pixels[:])

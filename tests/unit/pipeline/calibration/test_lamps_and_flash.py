from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from pipeline.calibration.lamps_and_flash import lamps_and_flash, mean_light
from pipeline.errors import OptionError, UnusablePairError
from pipeline.images.noise import Noise
from pipeline.pair.pair import Pair
from tests.targets import Shot

_NOISE = Noise(np.full(3, 1e-4), np.full(3, 1e-6))


@pytest.fixture
def flat(pair_of: Callable[..., Pair]) -> Callable[..., Pair]:
    def build(flash: float = 0.5, **more: object) -> Pair:
        lit = np.full((40, 40, 3), 0.2)
        shot = Shot((lit, lit + np.array([1.0, 0.5, 0.25]) * flash), (b"", b""))
        return pair_of(shot, no_flash_noise=_NOISE, flash_noise=_NOISE, **more)

    return build


def _middle() -> np.ndarray:
    mask = np.zeros((40, 40), bool)
    mask[10:20, 10:20] = True
    return mask


def test_the_flash_part_is_the_difference_and_has_the_noise_of_both(
    flat: Callable[..., Pair],
) -> None:
    found = mean_light(flat(), _middle(), "the card")
    assert found.lamps == pytest.approx(0.2)
    assert found.flash == pytest.approx([0.5, 0.25, 0.125], rel=1e-5)
    single = 1e-4 * np.array([0.2 + 0.7, 0.2 + 0.45, 0.2 + 0.325]) + 2e-6
    assert found.flash_variance == pytest.approx(single / 100, rel=1e-5)


def test_a_flash_part_alone_is_taken_as_it_is(flat: Callable[..., Pair]) -> None:
    found = mean_light(flat(flash_only=True), _middle(), "the card")
    assert found.flash == pytest.approx([0.7, 0.45, 0.325])
    assert found.flash_variance == pytest.approx((1e-4 * found.flash + 1e-6) / 100)


def test_means_of_blocks_are_less_noisy(flat: Callable[..., Pair]) -> None:
    value = np.array([0.3, 0.3, 0.3])
    one, nine = (lamps_and_flash(flat(), value, 2 * value, averaged) for averaged in (1.0, 9.0))
    assert nine.flash == pytest.approx(value)
    assert nine.lamps_variance == pytest.approx(one.lamps_variance / 9)


def test_each_photograph_has_its_own_noise(flat: Callable[..., Pair]) -> None:
    value = np.array([0.3, 0.3, 0.3])
    pair = replace(flat(), flash_noise=Noise(np.zeros(3), np.full(3, 4e-6)))
    found = lamps_and_flash(pair, value, 2 * value, 1.0)
    assert found.lamps_variance == pytest.approx(3.1e-5)
    assert found.flash_variance == pytest.approx(3.5e-5)


def test_clipped_pixels_do_not_count(flat: Callable[..., Pair]) -> None:
    pair, clipped = flat(), np.zeros((40, 40), bool)
    clipped[10, 10:19] = True
    pair.no_flash[:][clipped] = pair.flash[:][clipped] = 9.0
    found = mean_light(replace(pair, unusable=clipped), _middle(), "the card")
    assert found.lamps == pytest.approx(0.2)
    assert found.flash_variance[0] == pytest.approx((1e-4 * 0.9 + 2e-6) / 91, rel=1e-5)
    clipped[11, 10:12] = True
    with pytest.raises(UnusablePairError, match="The card is clipped"):
        mean_light(replace(pair, unusable=clipped), _middle(), "the card")


def test_nine_pixels_will_do(flat: Callable[..., Pair]) -> None:
    mask = np.zeros((40, 40), bool)
    mask[3, :9] = True
    assert mean_light(flat(), mask, "the card").flash[0] == pytest.approx(0.5)
    mask[3, 0] = False
    with pytest.raises(OptionError, match="covers hardly a pixel"):
        mean_light(flat(), mask, "the card")


@pytest.mark.parametrize(("deviations", "reached"), [(3.9, False), (4.1, True)])
def test_the_flash_reaches_where_its_faintest_channel_is_told_from_noise(
    flat: Callable[..., Pair], deviations: float, reached: bool
) -> None:
    """Blue, which has a quarter of red's light."""
    blue = deviations * np.sqrt((1e-4 * 0.4 + 2e-6) / 100)
    pair = flat(flash=4 * blue)
    if reached:
        assert mean_light(pair, _middle(), "the card").flash[2] == pytest.approx(blue, rel=1e-3)
    else:
        with pytest.raises(UnusablePairError, match="The card shows no blue in the light of"):
            mean_light(pair, _middle(), "the card")


def test_colours_that_a_rendering_cut_off_are_told(pair_of: Callable[..., Pair]) -> None:
    """Of a deep cyan, whose red is below what sRGB holds, near the flash."""
    lit = np.full((40, 40, 3), 0.2)
    shot = Shot((lit, lit + np.array([-0.01, 0.2, 0.3])), (b"", b""))
    pair = pair_of(shot, no_flash_noise=_NOISE, flash_noise=_NOISE)
    with pytest.raises(UnusablePairError) as caught:
        mean_light(pair, _middle(), "patch 18 of the chart")
    assert str(caught.value) == (
        "Patch 18 of the chart shows no red in the light of the flash: bring it nearer or raise "
        "its power. JPEGs and other renderings cut off colours that sRGB does not hold: send RAW "
        "files, or mark a grey card."
    )


def test_areas_that_tell_nothing_are_refused(flat: Callable[..., Pair]) -> None:
    with pytest.raises(OptionError, match="mark of the card covers hardly a pixel"):
        mean_light(flat(), np.zeros((40, 40), bool), "the card")
    clipped = _middle()
    clipped[:, 12:] = False
    with pytest.raises(UnusablePairError, match="The card is clipped"):
        mean_light(flat(unusable=clipped), _middle(), "the card")
    with pytest.raises(UnusablePairError, match="flash does not reach the card"):
        mean_light(flat(flash=1e-5), _middle(), "the card")

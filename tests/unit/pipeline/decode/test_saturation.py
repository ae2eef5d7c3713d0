"""Where a sensor's values end below the white level that is told."""

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.arrays import Floats64
from pipeline.decode.saturation import end_below_white, saturation

_BLACK, _WHITE = 512.0, 15_871.0
_TOLD = 16_225.0  # 512 + .99 of 15,871, to whole values


def _photosites(light: Floats64, end: float, full_well: float) -> NDArray[np.uint16]:
    """Values of a sensor of so many electrons at white, which ends at that value."""
    noise = np.random.default_rng(0).normal(size=light.shape)
    values = _BLACK + _WHITE * (light + noise * np.sqrt(np.maximum(light, 0) / full_well))
    return np.clip(np.rint(values), 0, end).astype(np.uint16)


def _room(brightest: float) -> Floats64:
    """Light that falls from a window, which is so bright, into a room."""
    x, y = np.meshgrid(np.linspace(0, 1, 300), np.linspace(0, 1, 200))
    room = 0.5 * np.exp(-2 * (x + y))
    room[20:60, 20:50] = brightest
    return room


@pytest.mark.parametrize("end", [15_778, 15_000, 13_500])
@pytest.mark.parametrize("full_well", [5_000.0, 60_000.0])
def test_values_that_pile_up_below_the_white_level_are_clipped(end: int, full_well: float) -> None:
    values = _photosites(_room(3.0), end, full_well)

    limit = saturation(values, _BLACK, _WHITE)

    assert end - 80 < limit <= end - 79  # .005 of the white level
    assert np.count_nonzero(values >= limit) == 40 * 30


def test_clipped_values_may_scatter_a_little() -> None:
    values = _photosites(_room(3.0), 15_700, 60_000.0)
    high = values == 15_700
    values[high] -= np.random.default_rng(1).integers(0, 75, high.sum(), dtype=np.uint16)

    assert np.count_nonzero(values >= saturation(values, _BLACK, _WHITE)) == 40 * 30


@pytest.mark.parametrize("brightest", [0.8, 0.9, 0.95])
@pytest.mark.parametrize("full_well", [5_000.0, 60_000.0, 100_000.0])
def test_even_light_below_white_is_not_clipped(brightest: float, full_well: float) -> None:
    values = _photosites(_room(brightest), 2**16 - 1, full_well)

    assert saturation(values, _BLACK, _WHITE) == _TOLD


@pytest.mark.parametrize("full_well", [5_000.0, 60_000.0, 100_000.0])
def test_a_wall_all_over_the_picture_is_not_clipped(full_well: float) -> None:
    """Of 300,000 photosites hundreds lie near the brightest, and far more below."""
    values = _photosites(np.full((500, 600), 0.9), 2**16 - 1, full_well)

    assert saturation(values, _BLACK, _WHITE) == _TOLD


def test_light_that_rises_smoothly_to_its_brightest_is_not_clipped() -> None:
    x, y = np.meshgrid(np.linspace(-1, 1, 300), np.linspace(-1, 1, 200))

    assert saturation(_photosites(0.9 - 0.4 * (x**2 + y**2), 2**16 - 1, 1e12), _BLACK, _WHITE) == (
        _TOLD
    )


@pytest.mark.parametrize("count", [0, 1, 99])
def test_few_photosites_tell_nothing(count: int) -> None:
    values = np.full(5_000, 4_000, np.uint16)
    values[:count] = 15_000

    assert saturation(values, _BLACK, _WHITE) == _TOLD


def test_a_hundred_tell() -> None:
    values = np.full(5_000, 4_000, np.uint16)
    values[:100] = 15_000

    assert saturation(values, _BLACK, _WHITE) == 14_921  # 15,000 less .005 of 15,871


@pytest.mark.parametrize("value", [0, 512, 12_000])
def test_a_dark_picture_without_noise_has_no_end(value: int) -> None:
    assert saturation(np.full((40, 40), value, np.uint16), _BLACK, _WHITE) == _TOLD


def test_what_reaches_the_white_level_ends_there() -> None:
    values = np.full(5_000, 15_000, np.uint16)
    values[0] = 16_225

    assert saturation(values, _BLACK, _WHITE) == _TOLD


def test_no_photosites_have_no_end() -> None:
    assert saturation(np.empty((0, 4), np.uint16), _BLACK, _WHITE) == _TOLD


def _linear(light: Floats64, end: float, full_well: float = 20_000.0) -> Floats64:
    """Linear values of a file, 1 = white, of a sensor that ends at that value."""
    noise = np.random.default_rng(0).normal(size=light.shape)
    return np.minimum(light + noise * np.sqrt(np.maximum(light, 0) / full_well), end)


@pytest.mark.parametrize("end", [0.2, 0.8, 0.99])
def test_linear_values_that_pile_up_below_white_are_clipped_there(end: float) -> None:
    values = _linear(_room(3.0), end)

    limit = end_below_white(values, 1.0)

    assert limit is not None
    assert limit == pytest.approx(0.995 * end)
    assert np.count_nonzero(values >= limit) >= 40 * 30


def test_what_pile_up_at_white_needs_no_other_end() -> None:
    assert end_below_white(_linear(_room(3.0), 1.0), 1.0) is None


@pytest.mark.parametrize("brightest", [0.2, 0.5, 0.9])
def test_linear_values_of_even_light_have_no_end(brightest: float) -> None:
    assert end_below_white(_linear(_room(brightest), np.inf), 1.0) is None


@pytest.mark.parametrize(("count", "told"), [(99, False), (100, True)])
def test_a_hundred_linear_values_tell(count: int, told: bool) -> None:
    values = np.full(5_000, 0.1)
    values[:count] = 0.5

    assert (end_below_white(values, 1.0) is not None) is told


@pytest.mark.parametrize(("share", "told"), [(0.5, True), (0.501, False)])
def test_of_values_that_are_mostly_alike_none_is_clipped(share: float, told: bool) -> None:
    values = np.full(5_000, 0.1)
    values[: int(share * 5_000)] = 0.5

    assert (end_below_white(values, 1.0) is not None) is told


@pytest.mark.parametrize(("below", "told"), [(300, True), (301, False)])
def test_a_pile_holds_no_less_than_what_lies_just_below_it(below: int, told: bool) -> None:
    values = np.full(5_000, 0.1)
    values[:300], values[300 : 300 + below] = 0.5, 0.48

    assert (end_below_white(values, 1.0) is not None) is told


@pytest.mark.parametrize("values", [np.zeros(5_000), np.full(5_000, -0.1), np.empty(0)])
def test_black_and_nothing_have_no_end(values: Floats64) -> None:
    assert end_below_white(values, 1.0) is None

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from pipeline.calibration import evenness
from pipeline.calibration.evenness import check_even
from pipeline.errors import OptionError
from pipeline.images.noise import Noise
from pipeline.pair.pair import Pair
from tests.targets import Shot

_Y, _X = (np.mgrid[:60, :80] + 0.5) / 60
_MASK = np.hypot(_X - 0.6, _Y - 0.5) < 0.4
_FLASH = np.array([0.6, 0.5, 0.2])


@pytest.fixture
def lit(pair_of: Callable[..., Pair]) -> Callable[..., Pair]:
    """A pair with this light of the flash beside that of a lamp, and noise of this deviation."""

    def build(flash: np.ndarray, deviation: float = 1e-3, **more: object) -> Pair:
        random = np.random.default_rng(1)
        lamp = 0.1 + 0.3 * (_X > 0.7)[..., None] * np.array([1.0, 0.4, 0.1])
        noise = [random.normal(0, deviation, (60, 80, 3)) for _ in range(2)]
        known = Noise(np.zeros(3), np.full(3, deviation**2))
        shot = Shot((lamp + noise[0], lamp + flash + noise[1]), (b"", b""))
        return pair_of(shot, no_flash_noise=known, flash_noise=known, **more)

    return build


@pytest.mark.parametrize("enough", [2**18, 500])
def test_shading_and_noise_and_the_light_of_lamps_are_no_edge(
    enough: int, lit: Callable[..., Pair], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(evenness, "_ENOUGH", enough)
    shading = 1 / (1 + np.square(_X) + 0.3 * _Y)[..., None]
    assert np.ptp(shading[_MASK]) > 0.3
    check_even(lit(_FLASH * shading), _MASK)
    check_even(lit(_FLASH * shading, deviation=0.2), _MASK)


@pytest.mark.parametrize("beside", [(0.6, 0.5, 0.26), (0.4, 0.33, 0.133), (0.1, 0.1, 0.1)])
@pytest.mark.parametrize("enough", [2**18, 500])
def test_two_surfaces_are_refused(
    beside: tuple[float, ...],
    enough: int,
    lit: Callable[..., Pair],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(evenness, "_ENOUGH", enough)
    pair = lit(np.where((_X < 0.6)[..., None], _FLASH, np.array(beside)))
    with pytest.raises(
        OptionError,
        match=r"^The mark of the grey card shows more than one even surface in the light of the "
        r"flash: check its coordinates, .*, and keep it within the edges, "
        r"without gloss or shadows\.$",
    ):
        check_even(pair, _MASK)
    check_even(pair, _MASK & (_X < 0.6))


def test_what_is_clipped_is_left_out(lit: Callable[..., Pair]) -> None:
    hot = np.hypot(_X - 0.6, _Y - 0.5) < 0.1
    flash = np.where(hot[..., None], 1.0, _FLASH)
    with pytest.raises(OptionError, match="more than one even surface"):
        check_even(lit(flash), _MASK)
    check_even(lit(flash, unusable=hot), _MASK)


def test_a_mark_of_few_pixels_is_no_edge(lit: Callable[..., Pair]) -> None:
    few = np.zeros((60, 80), bool)
    few[20:23, 30:33] = True
    check_even(lit(np.broadcast_to(_FLASH, (60, 80, 3)), 0.02), few)

from __future__ import annotations

import numpy as np
import pytest

from drivers.sim.sensor import BLACK, WHITE, digitise


def flat(level: float, side: int = 256) -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
    return np.full((side, side), level, np.float32)


def test_without_noise_numbers_are_proportional_to_light() -> None:
    light = np.array([[0.0, 0.25, 0.5, 1.0, 1.5, -0.1]], np.float32)
    span = WHITE - BLACK
    expected = [BLACK, BLACK + span / 4, BLACK + span / 2, WHITE, WHITE, 0]
    numbers = digitise(light, 100, None)
    assert numbers.dtype == np.uint16
    assert numbers[0, :5].tolist() == expected[:5]
    assert numbers[0, 5] == 0  # what lies under black is clipped at zero


@pytest.mark.parametrize("iso", [100, 400, 6400])
def test_iso_amplifies(iso: float) -> None:
    light = flat(0.01, 2)
    expected = min(WHITE, round(BLACK + 0.01 * (WHITE - BLACK) * iso / 100))
    assert np.abs(digitise(light, iso, None).astype(int) - expected).max() <= 1


@pytest.mark.parametrize("level", [0.0, 0.05, 0.5])
def test_noise_has_the_variance_of_electrons_and_amplifier(level: float) -> None:
    """40,000 electrons at white, 3 of readout: docs/decisions/0003-simulated-camera.md."""
    gain = (WHITE - BLACK) / 40_000
    numbers = digitise(flat(level), 100, np.random.default_rng(7)).astype(float)
    variance = (level * 40_000 + 3.0**2) * gain**2 + 1 / 12  # and rounding
    assert numbers.var() == pytest.approx(variance, rel=0.03)
    assert numbers.mean() == pytest.approx(BLACK + level * (WHITE - BLACK), abs=0.3)

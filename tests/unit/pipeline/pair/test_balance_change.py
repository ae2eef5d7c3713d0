from __future__ import annotations

import numpy as np

from pipeline.colour.curves import srgb_to_linear
from pipeline.images.coded_image import TableImage
from pipeline.images.noise import Noise
from pipeline.pair.balance_change import TO_SENSOR, BalanceChange

WARMER = BalanceChange(1.25, 0.8)


def test_the_sensors_channels_are_divided_by_the_gains() -> None:
    sensor = np.random.default_rng(2).uniform(0.1, 0.4, (70, 5, 3))
    to_srgb = np.linalg.inv(TO_SENSOR).T
    flash = (sensor * (1.25, 1.0, 0.8) @ to_srgb).astype(np.float32)

    balanced = WARMER.photograph(flash)

    np.testing.assert_allclose(balanced, sensor @ to_srgb, atol=1e-6)


def test_grey_of_a_sensor_is_grey_in_srgb() -> None:
    np.testing.assert_allclose(TO_SENSOR.sum(axis=1), 1.0, rtol=1e-12)
    np.testing.assert_allclose(BalanceChange(1.0, 1.0).matrix, np.eye(3), atol=1e-12)


def test_code_values_become_what_floats_become() -> None:
    codes = np.random.default_rng(1).integers(0, 256, (70, 5, 3), dtype=np.uint8)
    table = srgb_to_linear(np.arange(256, dtype=np.float32) / 255)
    floats = table[codes]

    of_codes = WARMER.photograph(TableImage(codes, table), own=True)

    np.testing.assert_array_equal(of_codes, WARMER.photograph(floats))
    np.testing.assert_array_equal(floats, table[codes])


def test_pixels_of_ones_own_are_written_over() -> None:
    floats = np.full((3, 4, 3), 0.2, np.float32)
    expected = WARMER.photograph(floats)

    balanced = WARMER.photograph(floats, own=True)

    assert balanced is floats
    np.testing.assert_array_equal(balanced, expected)


def test_noise_goes_through_the_matrix_as_that_of_grey_does() -> None:
    noise = Noise(np.array((2e-4, 1e-4, 3e-4)), np.array((1e-6, 2e-6, 3e-6)), 2.0)
    even = Noise(np.zeros(3), noise.floor + noise.gain * 0.3)

    found = WARMER.noise(noise)

    expected = np.square(WARMER.matrix) @ even.floor
    became = WARMER.matrix @ np.full(3, 0.3)
    np.testing.assert_allclose(found.variance(became), expected, rtol=1e-9)
    assert found.grain == 2.0


def test_the_manifest_has_the_gains() -> None:
    assert BalanceChange(1.30049, 0.75).entry() == {"red": 1.3, "blue": 0.75}

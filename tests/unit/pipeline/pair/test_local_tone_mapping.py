"""Factors of blocks, enlarged to the pixels of a photograph."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.images.coded_image import TableImage
from pipeline.images.noise import Noise
from pipeline.pair.local_tone_mapping import LocalToneMapping

MAPPING = LocalToneMapping(np.log([[0.5, 1.5], [0.5, 1.5]]), 50, 0.25)


def test_blocks_are_enlarged_between_their_middles() -> None:
    photograph = np.full((100, 100, 3), 0.2, np.float32)

    mapped = MAPPING.photograph(photograph)

    assert mapped is not photograph
    np.testing.assert_allclose(mapped[:, :25], 0.1, rtol=1e-6)
    np.testing.assert_allclose(mapped[:, 75:], 0.3, rtol=1e-6)
    np.testing.assert_allclose(mapped[99, 49], 0.2 * 0.99, rtol=1e-5)
    np.testing.assert_array_equal(photograph, np.float32(0.2))


def test_pixels_beyond_the_last_block_have_its_factor() -> None:
    mapped = MAPPING.photograph(np.ones((110, 130, 3), np.float32))

    np.testing.assert_allclose(mapped[105:, 110:], 1.5, rtol=1e-6)


def test_a_photograph_of_codes_becomes_light() -> None:
    codes = np.full((100, 100, 3), 128, np.uint8)
    table = np.linspace(0.0, 1.0, 256, dtype=np.float32)

    mapped = MAPPING.photograph(TableImage(codes, table), own=True)

    assert isinstance(mapped, np.ndarray)
    np.testing.assert_allclose(mapped[:, 80:], 1.5 * 128 / 255, rtol=1e-6)
    np.testing.assert_array_equal(codes, 128)


def test_memory_of_its_own_is_written_over() -> None:
    photograph = np.ones((100, 100, 3), np.float32)

    assert MAPPING.photograph(photograph, own=True) is photograph
    assert photograph[0, 0, 0] == np.float32(0.5)


def test_noise_goes_along_in_the_mean() -> None:
    mapping = LocalToneMapping(np.log([[1.0, 3.0]]), 8, 0.25)

    noise = mapping.noise(Noise(np.full(3, 1e-3), np.full(3, 1e-4)))

    np.testing.assert_allclose(noise.gain, 2e-3)
    np.testing.assert_allclose(noise.floor, 4e-4)


def test_the_manifest_says_the_power_and_the_range() -> None:
    assert MAPPING.entry() == {
        "power": 0.25,
        "least": pytest.approx(0.5),
        "most": pytest.approx(1.5),
    }

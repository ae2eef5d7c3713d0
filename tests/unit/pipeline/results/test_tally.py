from __future__ import annotations

import numpy as np
import pytest

from pipeline.arrays import Floats32
from pipeline.results.tally import Tally

SIZE = (12, 7)


@pytest.fixture
def strip() -> tuple[Floats32, Floats32]:
    """Layers of two lamps, some of it below black, and a confidence."""
    rng = np.random.default_rng(4)
    layers = rng.uniform(-0.1, 1.0, (2, *SIZE, 3)).astype(np.float32)
    return layers, rng.uniform(0, 1, SIZE).astype(np.float32)


def tallied(layers: Floats32, confidence: Floats32, strip_rows: int) -> Tally:
    tally = Tally(len(layers), *confidence.shape)
    for top in range(0, len(confidence), strip_rows):
        rows = slice(top, top + strip_rows)
        tally.add(slice(*rows.indices(len(confidence))), layers[:, rows], confidence[rows])
    return tally


def test_each_lamp_has_the_share_of_its_light_that_was_separated(
    strip: tuple[Floats32, Floats32],
) -> None:
    """Σ confidence · layer ÷ Σ layer, of what is above black."""
    layers, confidence = strip

    found = tallied(layers, confidence, 5).separated

    light = np.maximum(layers.astype(np.float64), 0).sum(axis=3)
    expected = (light * confidence).sum(axis=(1, 2)) / light.sum(axis=(1, 2))
    np.testing.assert_allclose(found, expected, rtol=1e-6)
    assert 0.4 < found[0] < 0.6
    assert found[0] != pytest.approx(found[1], rel=1e-3)


def test_pixels_of_little_confidence_count_as_filled_in() -> None:
    confidence = np.ones(SIZE, np.float32)
    confidence[2:4, 1:6] = 0.499
    confidence[8, :] = 0.5

    assert tallied(np.ones((1, *SIZE, 3), np.float32), confidence, 3).filled == 10 / (12 * 7)


@pytest.mark.parametrize("strip_rows", [1, 5])
def test_strips_count_the_same(strip: tuple[Floats32, Floats32], strip_rows: int) -> None:
    whole, cut = tallied(*strip, 12), tallied(*strip, strip_rows)

    assert cut.filled == whole.filled
    np.testing.assert_array_equal(cut.separated, whole.separated)


@pytest.mark.parametrize("light", [0.0, -0.1])
def test_a_layer_without_light_has_no_separated_share(light: float) -> None:
    layers = np.full((2, *SIZE, 3), light, np.float32)
    layers[1] = 1.0

    np.testing.assert_allclose(tallied(layers, np.ones(SIZE, np.float32), 12).separated, [0, 1])

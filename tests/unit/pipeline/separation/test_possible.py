from __future__ import annotations

import numpy as np
import pytest

from pipeline.separation.possible import off_possible


@pytest.mark.parametrize("count", [1, 2, 3])
def test_layers_that_add_up_are_possible(count: int) -> None:
    layers = np.random.default_rng(0).uniform(size=(count, 4, 5, 3)).astype(np.float32)

    off = off_possible(layers.sum(axis=0), layers)

    assert off.shape == (4, 5)
    np.testing.assert_allclose(off, 0, atol=1e-6)


@pytest.mark.parametrize(
    ("light", "layers", "nearest"),
    [
        (1.0, (1.4,), (1.0,)),
        (1.0, (1.2, -0.2), (1.0, 0.0)),
        (1.0, (0.6, 0.7), (0.45, 0.55)),
        (1.0, (0.9, -0.5), (1.0, 0.0)),
        (1.0, (0.8, 0.6, -0.3), (0.6, 0.4, 0.0)),
        (1.0, (1.7, -0.4, 0.2), (1.0, 0.0, 0.0)),
        (1.0, (-0.2, -0.2, -0.2), (1 / 3, 1 / 3, 1 / 3)),
        (1.0, (300.0, 0.0), (1.0, 0.0)),
    ],
)
def test_others_are_off_by_the_way_to_the_nearest(
    light: float, layers: tuple[float, ...], nearest: tuple[float, ...]
) -> None:
    """In one channel; the others are possible."""
    found = np.array([[one, 0.0, 0.0] for one in layers])

    off = off_possible(np.array([light, 0.0, 0.0]), found)

    assert off == pytest.approx(np.linalg.norm(np.subtract(layers, nearest)))


@pytest.mark.parametrize("count", [1, 2, 3])
def test_layers_are_never_nearer_to_the_true_ones(count: int) -> None:
    random = np.random.default_rng(1)
    truth = random.uniform(size=(count, 500, 3))
    found = truth + random.normal(size=truth.shape)

    off = off_possible(truth.sum(axis=0), found)

    error = np.linalg.norm(found - truth, axis=(0, 2))
    assert np.all(off <= error)
    assert np.median(off / error) > 0.4

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.images.frames import Image
from pipeline.light.model import Model
from pipeline.matrixfit.deviations import TERMS, Deviations
from pipeline.separation.proportions import model_proportions, predictions
from tests.definitions import pixels


@pytest.mark.parametrize("count", [1, 2, 3])
def test_predictions_are_the_flash_part_through_each_lamp(
    model: Model,
    lamps_of: Callable[..., Any],
    flash_part: Image,
    warm_to_cool: Floats64,
    count: int,
) -> None:
    lamps = lamps_of(warm_to_cool[:count])

    found = predictions(flash_part, lamps)

    assert found.shape == (count, *flash_part.shape)
    for one, coefficients in zip(found, warm_to_cool, strict=False):
        np.testing.assert_allclose(
            one, flash_part @ model.lamp_matrix(coefficients).T, rtol=1e-4, atol=1e-6
        )


def test_predictions_are_never_negative(
    lamps_of: Callable[..., Any], warm_to_cool: Floats64
) -> None:
    flash = np.random.default_rng(2).normal(0, 1, (20, 20, 3)).astype(np.float32)

    assert predictions(flash, lamps_of(warm_to_cool)).min() == 0


@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize("weights", [(1, 1, 1), (0.3, 1, 4)], ids=["equal", "unequal"])
def test_proportions_are_those_of_the_layers(
    exact: Callable[..., tuple[Any, Floats64]],
    lamps_of: Callable[..., Any],
    flash_part: Image,
    warm_to_cool: Floats64,
    count: int,
    weights: tuple[float, ...],
) -> None:
    pair, layers = exact(warm_to_cool[:count])
    lamps = lamps_of(warm_to_cool[:count], channel_weights=np.array(weights))

    found = model_proportions(pair.no_flash, flash_part, lamps)

    np.testing.assert_allclose(found, layers / layers.sum(axis=0), atol=1e-4)


@pytest.mark.parametrize("scale", [1e3, 1e-2, 1e-4])
@pytest.mark.parametrize("count", [2, 3])
def test_proportions_do_not_depend_on_how_bright_a_pixel_is(
    exact: Callable[..., tuple[Any, Floats64]],
    lamps_of: Callable[..., Any],
    flash_part: Image,
    warm_to_cool: Floats64,
    count: int,
    scale: float,
) -> None:
    pair, layers = exact(warm_to_cool[:count])
    given = np.asarray(pair.no_flash * np.float32(scale))

    found = model_proportions(given, flash_part * np.float32(scale), lamps_of(warm_to_cool[:count]))

    np.testing.assert_allclose(found, layers / layers.sum(axis=0), atol=1e-4)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_proportions_sum_to_one_whatever_the_pixels_hold(
    lamps_of: Callable[..., Any], warm_to_cool: Floats64, count: int
) -> None:
    rng = np.random.default_rng(4)
    no_flash, flash = rng.normal(0.05, 0.1, (2, 40, 40, 3)).astype(np.float32)
    no_flash[:5], flash[3:8] = 0, 0

    found = model_proportions(no_flash, flash, lamps_of(warm_to_cool[:count]))

    np.testing.assert_allclose(found.sum(axis=0), 1, atol=1e-5)
    assert (found >= 0).all()


@pytest.mark.parametrize("count", [1, 2, 3])
def test_without_light_every_lamp_has_an_equal_part(
    lamps_of: Callable[..., Any], warm_to_cool: Floats64, count: int
) -> None:
    black = np.zeros((2, 2, 3), np.float32)

    found = model_proportions(black, black, lamps_of(warm_to_cool[:count]))

    np.testing.assert_allclose(found, 1 / count, rtol=1e-6)


def test_a_channel_the_model_gives_no_light_takes_the_parts_of_the_whole(
    lamps_of: Callable[..., Any],
) -> None:
    """Two lamps without blue, by matrices of our own: blue is dealt out like red and green."""
    matrices = np.array([np.diag([1.0, 0.2, 0.0]), np.diag([0.2, 1.0, 0.0])])
    lamps = lamps_of(np.eye(3)[:2], matrices=matrices)
    flash = np.full((1, 1, 3), 0.5, np.float32)
    no_flash = np.array([[[0.5 * (0.6 + 0.2 * 0.2), 0.5 * (0.6 * 0.2 + 0.2), 0.1]]], np.float32)

    found = model_proportions(no_flash, flash, lamps)[:, 0, 0]

    np.testing.assert_allclose(found[:, 0], [0.6 / 0.64, 0.04 / 0.64], rtol=1e-4)
    np.testing.assert_allclose(found[:, 1], [0.12 / 0.32, 0.2 / 0.32], rtol=1e-4)
    np.testing.assert_allclose(found[:, 2], [0.75, 0.25], rtol=1e-4)


def test_channel_weights_settle_what_counts_where_the_model_does_not_fit(
    lamps_of: Callable[..., Any],
) -> None:
    matrices = np.array([np.diag([1.0, 0.5, 0.1]), np.diag([0.1, 0.5, 1.0])])
    flash = np.ones((1, 1, 3), np.float32)
    no_flash = np.array([[[1.0, 0.2, 1.0]]], np.float32)

    def warm_part(weights: tuple[float, float, float]) -> float:
        lamps = lamps_of(np.eye(3)[:2], matrices=matrices, channel_weights=np.array(weights))
        return float(model_proportions(no_flash, flash, lamps)[0, 0, 0, 1])

    assert warm_part((1, 1, 1)) == pytest.approx(0.5, abs=1e-5)
    assert warm_part((1, 1, 0.01)) > 0.9
    assert warm_part((0.01, 1, 1)) < 0.1


@pytest.mark.parametrize("bent", [0.0, 0.003], ids=["matrices", "deviations"])
@pytest.mark.parametrize("count", [1, 2, 3])
def test_proportions_are_what_they_are_defined_to_be(
    lamps_of: Callable[..., Any], warm_to_cool: Floats64, count: int, bent: float
) -> None:
    rng = np.random.default_rng(9)
    no_flash, flash = rng.uniform(0, 1, (2, 50, 60, 3)).astype(np.float32)
    no_flash[:4, :9], flash[2:6, 5:] = 0, 0
    terms = bent * rng.normal(0, 1, (count, 3, TERMS))
    lamps = lamps_of(
        warm_to_cool[:count],
        channel_weights=np.array([2.0, 1.0, 3.0]),
        deviations=Deviations(np.array([0.3, 0.4]), np.array([0.12, 0.1]), terms),
    )

    found = model_proportions(no_flash, flash, lamps)

    off = np.abs(found - pixels.model_proportions(no_flash, flash, lamps))
    # where lamps look alike, rounding decides between them
    assert np.quantile(off, 0.998) < 1e-4
